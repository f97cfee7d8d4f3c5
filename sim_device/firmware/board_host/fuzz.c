/* libFuzzer over scripts: what a host, a line and the sensors may do to the firmware, in any order.
 * Built with AddressSanitizer and UBSan; the findings are files that script_host takes too. */
#include "script.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void to_nowhere(void *to, const uint8_t *data, size_t length)
{
    (void)to;
    (void)data;
    (void)length;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    script_begin();
    (void)script_take(data, size, to_nowhere, NULL);
    return 0;
}
