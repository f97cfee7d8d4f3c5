/* libFuzzer target that runs random scripts: sequences of actions of host, link and sensors. It is
 * built with AddressSanitizer and UBSan. The first byte of an input selects the start: without a
 * session, or in a session that drives. The other bytes are a script, which script_host can also
 * run. */
#include "script.h"

#define LIFE_US 30000000u /* 3000 control periods: enough for the first legs of a plan */

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void discard(void *to, const uint8_t *data, size_t length)
{
    (void)to;
    (void)data;
    (void)length;
}

/* Frames of the two starts: host_hello with session 7, negotiated; clear_stop session_end; set_mode
 * velocity. Or set_mode onboard and planner_command start, then 3 s of running time. */
static const uint8_t driving[] = {
    'F', 1, 0x04, 0, 0, 0, 0, 9, 0, 0, 0, 0, 7, 0, 0, 0, 1, /**/
    'F', 1, 0x05, 0, 0, 0, 0, 3, 1, 0, 1,                   /**/
    'F', 1, 0x06, 0, 0, 0, 0, 3, 2, 0, 1,                   /**/
};
static const uint8_t planning[] = {
    'F', 1, 0x04, 0, 0, 0, 0, 9, 0, 0, 0, 0, 7, 0, 0, 0, 1, /**/
    'F', 1, 0x05, 0, 0, 0, 0, 3, 1, 0, 1,                   /**/
    'F', 1, 0x06, 0, 0, 0, 0, 3, 2, 0, 3,                   /**/
    'F', 1, 0x09, 0, 0, 0, 0, 4, 3, 0, 0, 0,                /**/
    'S', 0xB0, 0x71, 0x0B, 0, 0, 0,                         /* 750 ms, four times */
    'F', 1, 0x07, 0, 0, 0, 0, 1, 0,                         /**/
    'S', 0xB0, 0x71, 0x0B, 0, 0, 0,                         /**/
    'F', 1, 0x07, 0, 0, 0, 0, 1, 0,                         /**/
    'S', 0xB0, 0x71, 0x0B, 0, 0, 0,                         /**/
    'F', 1, 0x07, 0, 0, 0, 0, 1, 0,                         /**/
    'S', 0xB0, 0x71, 0x0B, 0, 0, 0,                         /**/
};

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size == 0) {
        return 0;
    }
    script_begin(LIFE_US);
    if (data[0] % 4u == 1u) {
        (void)script_take(driving, sizeof driving, discard, NULL);
    } else if (data[0] % 4u >= 2u) {
        (void)script_take(planning, sizeof planning, discard, NULL);
    }
    (void)script_take(data + 1, size - 1u, discard, NULL);
    return 0;
}
