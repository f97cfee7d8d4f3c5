#include "leg.h"

const char *leg_end_name(leg_end_t reason)
{
    static const char *const names[] = {
        "under way", "done", "distance", "range", "bumper", "cliff", "stalled", "timeout"};
    return names[reason];
}
