/* The tests' adapter for the generated C. It reads lines on stdin and writes lines on stdout.
 *
 *   decode    "cut,cut,... hex"                     events of a stream, in blocks and bytewise
 *   encode    "type node flags seq t_us word..."    "hex" of a frame with its leading zero
 *   payload   "type hex"                            "ok hex" decoded and encoded again, or "no"
 *   si        "type hex"                            "name=value:raw ..."
 *   describe  "type n"                              first the hash, then "fields length chain"
 *   describe-enum "key n"                           "key members chain"
 *   crc       "hex"                                 the CRC by software and by the unit's model
 *   can-send  "type node flags t_us word..."        "id:hex ..."
 *   can-hear  "now_us id hex"                       "-", "damaged" or the message
 *   bench     count                                 messages a second
 */
#include "adapter.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#ifdef SP_CRC_UNIT
extern uint32_t crc_unit_register;
#endif

enum { MAX_WORDS = 64 };

const adapter_message_t *adapter_find(uint8_t type)
{
    for (size_t i = 0; i < adapter_message_count; i++) {
        if (adapter_messages[i].type == type) {
            return &adapter_messages[i];
        }
    }
    return NULL;
}

long long adapter_number(const char *word)
{
    return strtoll(word, NULL, 0);
}

static unsigned digit(char c)
{
    return (unsigned)(c <= '9' ? c - '0' : c - 'a' + 10);
}

size_t adapter_unhex(char *word)
{
    const size_t length = word[0] == '-' ? 0 : strlen(word) / 2;
    for (size_t i = 0; i < length; i++) {
        word[i] = (char)(digit(word[2 * i]) << 4 | digit(word[2 * i + 1]));
    }
    return length;
}

void adapter_hex(const void *data, size_t length)
{
    const uint8_t *bytes = data;
    if (length == 0) {
        putchar('-');
    }
    for (size_t i = 0; i < length; i++) {
        putchar("0123456789abcdef"[bytes[i] >> 4]);
        putchar("0123456789abcdef"[bytes[i] & 15]);
    }
}

static void show_frame(const sp_frame_t *f)
{
    printf("%u %u %u %u %u %lu ", f->version, f->flags, f->node, f->type, f->seq,
        (unsigned long)f->t_us);
    adapter_hex(f->payload, f->length);
    /* A copy of exact size on the heap, so that a sanitizer reports a read beyond its end. */
    uint8_t *copy = malloc(f->length ? f->length : 1u);
    if (copy == NULL) {
        abort();
    }
    memcpy(copy, f->payload, f->length);
    const adapter_message_t *message = adapter_find(f->type);
    if (f->version != SP_VERSION) {
        printf(" version");
    } else if (message == NULL) {
        printf(" type");
    } else if (!message->show(copy, f->length)) {
        printf(" payload");
    }
    free(copy);
}

static void show_event(sp_event_t event, size_t end, const sp_frame_t *frame)
{
    static const char *const names[] = {"", "frame", "cobs", "length", "crc"};
    printf("%s %lu", names[event], (unsigned long)end);
    if (event == SP_FRAME) {
        putchar(' ');
        show_frame(frame);
    }
    putchar('\n');
}

static void decode(char **words, size_t count)
{
    char *cuts = count > 1 ? words[0] : NULL;
    char *const data = words[count - 1];
    const size_t length = adapter_unhex(data);
    static sp_parser_t blocks, bytes; /* cleared at the end of each line */
    sp_frame_t frame;
    sp_event_t event;
    size_t at = 0, counted = 0;
    const uint32_t frames = blocks.frames, damaged = blocks.damaged;
    while (at < length) {
        size_t end = cuts != NULL ? (size_t)strtoul(cuts, &cuts, 10) : length;
        cuts = cuts != NULL && *cuts == ',' ? cuts + 1 : NULL;
        end = end < length ? end : length;
        while (at < end) {
            at += sp_parser_block(&blocks, (uint8_t *)data + at, end - at, &frame, &event);
            if (event != SP_NOTHING) {
                show_event(event, at, &frame);
                counted++;
            }
        }
    }
    size_t single = 0;
    for (size_t i = 0; i < length; i++) {
        single += sp_parser_byte(&bytes, (uint8_t)data[i], &frame) != SP_NOTHING;
    }
    if (single != counted || bytes.frames != blocks.frames || bytes.damaged != blocks.damaged) {
        printf("bytewise differs\n");
    }
    printf(". %lu %lu\n", (unsigned long)(blocks.frames - frames),
        (unsigned long)(blocks.damaged - damaged));
    const uint32_t seen[2] = {blocks.frames, blocks.damaged};
    memset(&blocks, 0, sizeof blocks);
    memset(&bytes, 0, sizeof bytes);
    blocks.frames = bytes.frames = seen[0];
    blocks.damaged = bytes.damaged = seen[1];
}

static void encode(char **words)
{
    const adapter_message_t *message = adapter_find((uint8_t)adapter_number(words[0]));
    sp_sender_t sender = {(uint8_t)adapter_number(words[1]), (uint8_t)adapter_number(words[2]),
        (uint8_t)adapter_number(words[3]), 0};
    uint8_t *frame = malloc(SP_FRAME_MAX);
    if (message == NULL || frame == NULL) {
        abort();
    }
    const size_t length =
        message->frame(frame, &sender, (uint32_t)adapter_number(words[4]), words + 5);
    adapter_hex(frame, length);
    putchar('\n');
    free(frame);
}

static void payload(char **words)
{
    const adapter_message_t *message = adapter_find((uint8_t)adapter_number(words[0]));
    const size_t length = adapter_unhex(words[1]);
    uint8_t out[SP_PAYLOAD_MAX];
    const int again = message == NULL
        ? -1
        : message->again((uint8_t *)words[1], length, out, length);
    if (again < 0) {
        puts("no");
        return;
    }
    printf("ok ");
    adapter_hex(out, (size_t)again);
    putchar('\n');
}

static void si(char **words)
{
    const adapter_message_t *message = adapter_find((uint8_t)adapter_number(words[0]));
    const size_t length = adapter_unhex(words[1]);
    if (message != NULL) {
        message->si((uint8_t *)words[1], length);
    }
    putchar('\n');
}

static void describe(char **words)
{
    const sp_describe_t question = {
        (uint8_t)adapter_number(words[0]), (uint8_t)adapter_number(words[1])};
    sp_describe_reply_t answer;
    sp_describe(&question, &answer);
    printf("%u %u %u %lu %u\n", answer.described_type, answer.field_count, answer.payload_length,
        (unsigned long)answer.chain, (unsigned)sp_direction(question.described_type));
}

static void describe_enum(char **words)
{
    const sp_describe_enum_t question = {
        (uint32_t)adapter_number(words[0]), (uint8_t)adapter_number(words[1])};
    sp_describe_enum_reply_t answer;
    sp_describe_enum(&question, &answer);
    printf("%lu %u %lu\n", (unsigned long)answer.enumeration, answer.member_count,
        (unsigned long)answer.chain);
}

static void crc(char **words)
{
    const size_t length = adapter_unhex(words[0]);
    const uint8_t *const data = (uint8_t *)words[0];
    const size_t half = length / 2;
    const uint32_t first = sp_crc32_update(0, data, half);
    printf("%lu %lu", (unsigned long)sp_crc32_update(0, data, length),
        (unsigned long)sp_crc32_update(first, data + half, length - half));
#ifdef SP_CRC_UNIT
    printf(" %lu", (unsigned long)sp_crc32_unit(data, length));
#endif
    putchar('\n');
}

#if SP_WITH_CAN
static void can_send(char **words)
{
    static sp_can_sender_t sender;
    const adapter_message_t *message = adapter_find((uint8_t)adapter_number(words[0]));
    uint8_t frame[SP_FRAME_MAX];
    uint8_t body[SP_FRAME_MAX];
    sp_sender_t uart = {0};
    sp_parser_t parser = {0};
    sp_frame_t parsed = {0};
    sp_can_message_t tx;
    sp_can_frame_t out;
    const uint32_t t_us = (uint32_t)adapter_number(words[3]);
    const size_t length = message == NULL ? 0 : message->frame(frame, &uart, t_us, words + 4);
    for (size_t i = 0; i < length; i++) {
        (void)sp_parser_byte(&parser, frame[i], &parsed);
    }
    if (length == 0) {
        abort();
    }
    memcpy(body, parsed.payload, parsed.length);
    sender.node = (uint8_t)adapter_number(words[1]);
    sender.flags = (uint8_t)adapter_number(words[2]);
    if (sp_can_begin(&sender, &tx, parsed.type, t_us, body, parsed.length)) {
        while (sp_can_next(&sender, &tx, &out)) {
            printf("%u:", out.id);
            adapter_hex(out.data, out.length);
            putchar(' ');
        }
    }
    putchar('\n');
}

static void can_hear(char **words)
{
    static sp_can_receiver_t receiver;
#if SP_CAN_HOST_PARTS > 1
    if (strcmp(words[0], "limit") == 0) {
        sp_can_limit(&receiver, (uint8_t)adapter_number(words[1]), (size_t)adapter_number(words[2]));
        return;
    }
#endif
    const uint32_t now_us = (uint32_t)adapter_number(words[0]);
    sp_can_frame_t in = {(uint16_t)adapter_number(words[1]), 0, {0}};
    sp_frame_t frame;
    const size_t length = adapter_unhex(words[2]);
    in.length = (uint8_t)length;
    memcpy(in.data, words[2], length < 8 ? length : 8);
    const sp_event_t event = sp_can_receive(&receiver, &in, now_us, &frame);
    if (event == SP_FRAME) {
        show_frame(&frame);
    } else {
        printf(event == SP_BAD_CRC ? "damaged" : "-");
    }
    printf(" | %lu %lu %lu %lu\n", (unsigned long)receiver.damaged,
        (unsigned long)receiver.duplicates, (unsigned long)receiver.stale,
        (unsigned long)receiver.given_up);
}
#endif

static double seconds(clock_t from)
{
    return (double)(clock() - from) / CLOCKS_PER_SEC;
}

/* The frame's CRC by its definition, as a reference. */
static uint32_t crc_bit_by_bit(const uint8_t *data, size_t length)
{
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t i = 0; i < length; i++) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; bit++) {
            crc = (crc >> 1) ^ ((crc & 1u) ? 0xEDB88320u : 0u);
        }
    }
    return ~crc;
}

static void bench(long long count)
{
    static uint8_t stream[64 * 64];
    sp_sender_t sender = {1, 0, 0, 0};
    sp_imu_t imu = {1, 2, 3, 4, 5, 6, 7};
    size_t length = 0;
    uint32_t sum = 0;
    clock_t from = clock();
    for (long long i = 0; i < count; i++) {
        uint8_t frame[SP_FRAME_MAX];
        imu.gyro_z = (int16_t)(i & 0x7FFF);
        const size_t n = sp_imu_frame(frame, &sender, (uint32_t)i, &imu);
        sum += frame[n / 2];
        if (i < 64) {
            memcpy(stream + length, frame + 1, n - 1);
            length += n - 1;
        }
    }
    printf("encode %.0f\n", (double)count / seconds(from));
    sp_parser_t parser = {0};
    from = clock();
    for (long long i = 0; i < count; i += 64) {
        sp_frame_t frame;
        sp_event_t event;
        for (size_t at = 0; at < length;) {
            at += sp_parser_block(&parser, stream + at, length - at, &frame, &event);
            if (event == SP_FRAME && sp_imu_decode(&imu, frame.payload, frame.length)) {
                sum += (uint16_t)imu.gyro_z;
            }
        }
    }
    printf("decode %.0f\n", (double)parser.frames / seconds(from));
    from = clock();
    for (long long i = 0; i < count; i += 64) {
        for (size_t at = 0; at < length; at += length / 64) {
            stream[at] ^= (uint8_t)i; /* otherwise the compiler would hoist the call */
            sum += crc_bit_by_bit(stream + at, length / 64);
        }
    }
    printf("bits %.0f\n", (double)count / seconds(from));
    fprintf(stderr, "%lu\n", (unsigned long)sum); /* otherwise the loops would have no effect */
}

static char *read_line(void)
{
    static char *line;
    static size_t capacity;
    size_t length = 0;
    int c;
    while ((c = getchar()) != EOF && c != '\n') {
        if (length + 2 > capacity) {
            capacity = capacity * 2 + 4096;
            line = realloc(line, capacity);
            if (line == NULL) {
                abort();
            }
        }
        line[length++] = (char)c;
    }
    if (c == EOF) {
        free(line);
        return NULL;
    }
    if (line != NULL) {
        line[length] = 0;
    }
    return line;
}

int main(int argc, char **argv)
{
    const char *const mode = argc > 1 ? argv[1] : "";
    if (strcmp(mode, "bench") == 0) {
        bench(argc > 2 ? adapter_number(argv[2]) : 1000000);
        return 0;
    }
    if (strcmp(mode, "describe") == 0) {
        printf("%lu\n", (unsigned long)sp_catalogue_hash());
    }
    char *line;
    while ((line = read_line()) != NULL) {
        char *words[MAX_WORDS] = {0};
        size_t count = 0;
        for (char *word = strtok(line, " "); word && count < MAX_WORDS; word = strtok(NULL, " ")) {
            words[count++] = word;
        }
        if (strcmp(mode, "decode") == 0) {
            decode(words, count);
        } else if (strcmp(mode, "encode") == 0) {
            encode(words);
        } else if (strcmp(mode, "payload") == 0) {
            payload(words);
        } else if (strcmp(mode, "si") == 0) {
            si(words);
        } else if (strcmp(mode, "describe") == 0) {
            describe(words);
        } else if (strcmp(mode, "describe-enum") == 0) {
            describe_enum(words);
        } else if (strcmp(mode, "crc") == 0) {
            crc(words);
#if SP_WITH_CAN
        } else if (strcmp(mode, "can-send") == 0) {
            can_send(words);
        } else if (strcmp(mode, "can-hear") == 0) {
            can_hear(words);
#endif
        } else {
            fprintf(stderr, "unknown mode\n");
            return 2;
        }
    }
    return 0;
}
