/* A firmware library with an error that the environment variable BUG selects. Most errors occur
 * after two seconds. */
#define sweepctl_firmware core_firmware
#include "../../sim_device/firmware/board_library/library.c"
#undef sweepctl_firmware

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#define AFTER_US 2000000

BOARD_API_EXPORT const firmware_library_t *sweepctl_firmware(void);
void follow_the_pointer(volatile int *pointer);
void write_behind(size_t size);

void follow_the_pointer(volatile int *pointer)
{
    *pointer = 1;
}

void write_behind(size_t size)
{
    volatile char *const memory = malloc(size);
    memory[size] = 1;
    free((void *)(uintptr_t)memory);
}

static void poll(firmware_t *firmware)
{
    const char *const bug = getenv("BUG");
    firmware_poll(firmware);
    if (bug == NULL || firmware->now_us < AFTER_US) {
        return;
    }
    if (strcmp(bug, "pointer") == 0) {
        follow_the_pointer((volatile int *)(uintptr_t)8u);
    } else if (strcmp(bug, "assert") == 0) {
        assert(firmware->now_us < AFTER_US && "too late");
    } else if (strcmp(bug, "heap") == 0) {
        write_behind(4u);
    } else if (strcmp(bug, "loop") == 0) {
        for (;;) {
            follow_the_pointer(&(int){0});
        }
    } else if (strcmp(bug, "exit") == 0) {
        exit(7);
    }
}

const firmware_library_t *sweepctl_firmware(void)
{
    static firmware_library_t library;
    const char *const bug = getenv("BUG");
    library = *core_firmware();
    library.poll = poll;
    if (bug != NULL && strcmp(bug, "version") == 0) {
        library.version++;
    } else if (bug != NULL && strcmp(bug, "sizes") == 0) {
        library.sizes[3]++;
    } else if (bug != NULL && strcmp(bug, "imu") == 0) {
        library.imu_per_g = 1000.0f;
    }
    return &library;
}
