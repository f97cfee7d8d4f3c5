/* The sweeper's wire in C99: structs hold raw wire integers.
 *
 * Made by `sweepctl generate c`; changes belong into the catalogue.
 * Protocol version @version@, catalogue 0x@hash@, @messages@ messages.
 * SPDX-License-Identifier: MIT
 */

#ifndef SWEEPCTL_PROTOCOL_H
#define SWEEPCTL_PROTOCOL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Settings may stand in a file of your own: -DSP_CONFIG_FILE='"my_settings.h"'
 *   SP_MINIMAL             only what a driving device needs; SP_WITH_<MESSAGE> 0/1 chooses singly
 *   SP_WITH_CAN 0/1        frames for classic CAN
 *   SP_NO_FLOAT            no helpers in SI units
 *   SP_CRC_FULL_TABLE      1 KiB table instead of 64 B: 1.4 to 1.7 times as fast (on a PC)
 *   SP_CRC_UNIT            the STM32F4's CRC unit for whole words (see below)
 *   SP_CRC32(data, length) a function of your own instead of all that
 */
#ifdef SP_CONFIG_FILE
#include SP_CONFIG_FILE
#endif

#ifdef SP_MINIMAL
#define SP_WITH_REST 0
#else
#define SP_WITH_REST 1
#endif
#ifndef SP_WITH_CAN
#define SP_WITH_CAN SP_WITH_REST
#endif

@switches@
#ifdef __cplusplus
extern "C" {
#endif

/* ---- frames: 00 | COBS( header 8 B | payload | CRC-32 ) | 00 ------------------------------ */

#define SP_VERSION @version@u
#define SP_NODE_ALL 0u /* for the messages that sp_to_all() names, and no others */
#define SP_NODE_MAX @max_node@u
#define SP_FLAG_AUTHENTICATED @flag_authenticated@u
#define SP_HEADER_SIZE @header_size@u
#define SP_BODY_MIN @min_decoded@u
#define SP_BODY_MAX @max_decoded@u
#define SP_PAYLOAD_MAX @max_payload@u
#define SP_FRAME_MAX @max_frame@u /* both delimiters included */
/* Of a frame with SP_FLAG_AUTHENTICATED: counter and tag, behind its payload. On CAN they come in a
 * frame of their own type, at most so long after the message. */
#define SP_TRAILER_SIZE @trailer@u
#define SP_CAN_TRAILER_SIZE @can_trailer@u
#define SP_CAN_TAG_TYPE @auth_type@u
#define SP_CAN_TAG_US @together_us@u

/* Who sends: one for each port. */
typedef struct {
    uint8_t node;    /* the device's id, 1..15, whichever side sends */
    uint8_t flags;   /* SP_FLAG_* */
    uint8_t seq;     /* of the next frame */
    uint32_t frames; /* sent so far: what the sync message counts */
} sp_sender_t;

/* One intact frame. The payload stands in the parser until its next byte is fed. */
typedef struct {
    uint8_t version; /* compare with SP_VERSION: another version's frame is not to be decoded */
    uint8_t flags;
    uint8_t node;
    uint8_t type;
    uint8_t seq;
    uint8_t length; /* of the payload */
    uint32_t t_us;  /* sender's clock when the content was sampled */
    const uint8_t *payload;
} sp_frame_t;

typedef enum {
    SP_NOTHING = 0,    /* more bytes are needed */
    SP_FRAME = 1,      /* an intact frame */
    SP_BAD_COBS = 2,   /* bytes between two delimiters that are no frame: by their coding, */
    SP_BAD_LENGTH = 3, /* by their number, */
    SP_BAD_CRC = 4     /* by their check */
} sp_event_t;

/* Finds frames in a byte stream. All zero is a parser that has seen nothing. */
typedef struct {
    uint32_t frames;
    uint32_t damaged;
    uint8_t count; /* bytes since the delimiter; 255: too many */
    uint8_t left;  /* bytes left in the COBS group */
    uint8_t body[SP_BODY_MAX];
} sp_parser_t;

/* Take one byte: from an interrupt, if a CRC over at most 253 B at each frame's end is
 * short enough for it. */
sp_event_t sp_parser_byte(sp_parser_t *parser, uint8_t byte, sp_frame_t *frame);

/* Take a block until something is complete: gives the number of bytes taken and the event.
 *   while (n) { size_t k = sp_parser_block(&p, d, n, &f, &e); d += k; n -= k; if (e) ... } */
size_t sp_parser_block(
    sp_parser_t *parser, const uint8_t *data, size_t length, sp_frame_t *frame, sp_event_t *event);

/* Where a payload is encoded in a frame buffer of SP_FRAME_MAX bytes. */
static inline uint8_t *sp_payload(uint8_t *frame)
{
    return frame + 2u + SP_HEADER_SIZE;
}

/* Make the frame around a payload that stands at sp_payload(frame); gives its length, 0 where it
 * is too long. Its first byte is the leading zero: send it where the line was idle, else send
 * from frame + 1. */
size_t sp_seal(
    uint8_t *frame, sp_sender_t *sender, uint8_t type, uint32_t t_us, size_t payload_length);

/* CRC-32 of zlib; goes on from an earlier result, 0 at the start. */
uint32_t sp_crc32_update(uint32_t crc, const uint8_t *data, size_t length);
#ifdef SP_CRC_UNIT
/* The same by the STM32F4's unit, which must have its clock on and be used by nobody else
 * meanwhile. Define SP_CRC_UNIT_RESET(), SP_CRC_UNIT_WRITE(word) and SP_CRC_UNIT_READ() where
 * the registers are not those of the STM32F4. */
uint32_t sp_crc32_unit(const uint8_t *data, size_t length);
#endif

#ifndef SP_NO_FLOAT
static inline int32_t sp_round(float value, float low, float high)
{
    if (!(value > low)) { /* not a number: the least, too */
        return (int32_t)low;
    }
    if (value > high) {
        return (int32_t)high;
    }
    return (int32_t)(value < 0.0f ? value - 0.5f : value + 0.5f);
}
#endif

/* ---- values ------------------------------------------------------------------------------ */

@enums@
@latch_rule@
/* ---- messages ---------------------------------------------------------------------------- */

/* encode: the payload's length, or -1 where it does not fit.
 * decode: false where the length is not the message's.
 * frame: a whole frame in a buffer of SP_FRAME_MAX bytes; its length, 0 where it is too
 * long. */

@declarations@
@to_all@
@needs_tag@
@may_have_tag@
/* ---- agreement ---------------------------------------------------------------------------- */

#define SP_MAKERS_FIRST @makers_first@u /* types of makers' own messages */
#define SP_MAKERS_LAST @makers_last@u
#define SP_CATALOGUE_HASH 0x@hash@u /* of everything; sp_catalogue_hash() is what to send */
#define SP_UNKNOWN_COUNT 255u /* a count in a reply: no such message or enumeration here */

typedef enum { SP_UNKNOWN = 0, SP_FROM_HOST = 1, SP_FROM_DEVICE = 2 } sp_direction_t;

/* Who sends messages of a type, as far as this program was built with it. */
sp_direction_t sp_direction(uint8_t type);

/* Hash of all messages that this program was built with: for its hello. */
uint32_t sp_catalogue_hash(void);

/* Answer a host's question about a message, or about an enumeration. */
void sp_describe(const sp_describe_t *question, sp_describe_reply_t *answer);
void sp_describe_enum(const sp_describe_enum_t *question, sp_describe_enum_reply_t *answer);

/* Whether a host's message may end before its last fields, and how long its first `fields` are, a
 * text left out; 255: all of them. 0 of a type that is unknown. */
bool sp_is_bootstrap(uint8_t type);
uint8_t sp_prefix_size(uint8_t type, uint8_t fields);
uint8_t sp_field_count(uint8_t type);

#if SP_WITH_CAN
/* ---- classic CAN: id = type << 4 | node, 11 bits, at most 8 B ----------------------------- */

#ifndef SP_CAN_OPEN
#define SP_CAN_OPEN 2 /* transfers that are put together at the same time */
#endif
#ifndef SP_CAN_RECENT
#define SP_CAN_RECENT 4 /* frames of different ids that are known again when they are doubled */
#endif
#define SP_CAN_CONTENT_MAX @max_content@u

typedef struct {
    uint16_t id;
    uint8_t length;
    uint8_t data[8];
} sp_can_frame_t;

/* A device that sends. All zero but for the node is one that has sent nothing. */
typedef struct {
    uint8_t node;
    uint8_t flags;         /* SP_FLAG_*, of what is not periodic */
    uint8_t slow_sent;     /* bits: parts with a slow pace that were sent */
    uint32_t frames;       /* sent so far; it is put into every sync message */
    uint32_t slow_us[@slow_parts@];   /* when they were */
    uint8_t transfer[@messages@]; /* next transfer of each message */
} sp_can_sender_t;

/* A message on its way out. Its payload must stay until the last frame is fetched. */
typedef struct {
    const uint8_t *payload;
    uint32_t t_us;
    uint8_t type;
    uint8_t length;
    uint8_t native;
    uint8_t tail;
    uint8_t toggle;
    uint8_t head_length;
    uint16_t total; /* bytes of content, its CRC included */
    uint16_t position;
    uint8_t head[5];
    uint8_t crc[4];
} sp_can_message_t;

/* A transfer of which segments are still to come. */
typedef struct {
    uint32_t began_us;
    uint32_t order;
    uint16_t id;
    uint16_t length; /* 0: free */
    uint8_t transfer;
    uint8_t toggle;
    uint8_t data[SP_CAN_CONTENT_MAX + 4u];
} sp_can_transfer_t;

#define SP_CAN_HOST_PARTS @host_parts@ /* frames of a host's periodic message, at most */

#if SP_CAN_HOST_PARTS > 1
/* A periodic message of which parts are still to come. */
typedef struct {
    uint32_t t_us;
    uint8_t type;
    uint8_t node;
    uint8_t came; /* bits: the parts that are here */
    uint8_t part_length[SP_CAN_HOST_PARTS];
    uint8_t parts[SP_CAN_HOST_PARTS][6];
    uint8_t payload[SP_CAN_HOST_PARTS * 6u];
} sp_can_joined_t;
#endif

/* A device that listens to its host. All zero is one that has heard nothing. */
typedef struct {
    uint32_t frames;   /* messages that were complete */
    uint32_t damaged;  /* transfers whose CRC did not hold */
    uint32_t doubled;  /* frames that came twice */
    uint32_t stale;    /* messages with a stamp too old to be understood */
    uint32_t given_up; /* transfers that lost a segment */
    uint32_t wire_us;  /* newest stamp of the host */
    uint32_t ahead_us; /* host's clock less ours, by the quickest frame */
    uint32_t at_us;
    uint32_t order;
    bool stamped;
    uint8_t next_recent;
    uint8_t single[7]; /* content of a single frame */
    const uint8_t *content; /* of the message just received, which its tag covers; NULL: periodic */
    size_t content_length;
#if SP_CAN_HOST_PARTS > 1
    uint32_t incomplete; /* messages of which a part did not come */
    sp_can_joined_t joined;
    uint8_t unshared[@messages@]; /* last bytes of each message that the host does not know */
#endif
    struct {
        uint32_t at_us;
        sp_can_frame_t frame;
        bool used;
    } recent[SP_CAN_RECENT];
    sp_can_transfer_t open[SP_CAN_OPEN];
} sp_can_receiver_t;

/* Begin to send a message whose payload has been encoded; false where its length is wrong or its
 * type unknown. Then fetch its frames until there is no more. */
bool sp_can_begin(sp_can_sender_t *sender, sp_can_message_t *message, uint8_t type, uint32_t t_us,
    const uint8_t *payload, size_t length);
bool sp_can_next(sp_can_sender_t *sender, sp_can_message_t *message, sp_can_frame_t *frame);

/* Who sends frames of a type, which is a message's or that of one of its parts. */
sp_direction_t sp_can_direction(uint8_t can_type);

#if SP_CAN_HOST_PARTS > 1
/* The host knows so many bytes of a message's payload: it sends no parts beyond them. */
void sp_can_limit(sp_can_receiver_t *receiver, uint8_t type, size_t length);
#endif

/* Take a data frame with an 11-bit identifier that came at now_us. SP_FRAME: a message is
 * complete, its payload stands in the receiver until the next frame is taken. */
sp_event_t sp_can_receive(
    sp_can_receiver_t *receiver, const sp_can_frame_t *in, uint32_t now_us, sp_frame_t *frame);
#endif

#ifdef __cplusplus
}
#endif

#endif
