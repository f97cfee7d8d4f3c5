#include "payloads.h"

#include <string.h>

void payloads_reset(payloads_t *payloads)
{
    memset(payloads->known_fields, 0, sizeof payloads->known_fields);
}

void payloads_described(payloads_t *payloads, const sp_describe_t *question)
{
    const uint8_t type = question->described_type;
    /* A bootstrap message is never shortened, because the handshake needs all its fields. */
    if (sp_direction(type) == SP_FROM_HOST && !sp_is_bootstrap(type)) {
        const bool fewer = question->field_count < sp_field_count(type);
        payloads->known_fields[type] = fewer ? (uint8_t)(question->field_count + 1u) : 0u;
    }
}

uint8_t payloads_known(const payloads_t *payloads, uint8_t type)
{
    if (sp_direction(type) != SP_FROM_HOST) {
        return 0;
    }
    const uint8_t known = payloads->known_fields[type];
    return sp_prefix_size(type, known == 0 ? 255u : (uint8_t)(known - 1u));
}

bool payloads_fit(payloads_t *payloads, sp_frame_t *frame)
{
    if (sp_direction(frame->type) != SP_FROM_HOST) {
        return false;
    }
    const uint8_t whole = sp_prefix_size(frame->type, 255u);
    const bool all_known = payloads->known_fields[frame->type] == 0;
    if (frame->length == whole) {
        return true;
    }
    if (all_known) {
        /* A bootstrap message may be longer, because a later version may extend it. */
        return frame->length > whole && sp_is_bootstrap(frame->type);
    }
    const uint8_t known = payloads_known(payloads, frame->type);
    if (frame->length < known || whole > sizeof payloads->padded) {
        return false;
    }
    memset(payloads->padded, 0, sizeof payloads->padded);
    memcpy(payloads->padded, frame->payload, known); /* fields of a newer host are ignored */
    frame->payload = payloads->padded;
    frame->length = whole;
    return true;
}
