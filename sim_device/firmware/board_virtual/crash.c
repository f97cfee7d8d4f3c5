/* Prints the backtrace of a crash on stderr, one stack frame per line. Use it only for a program in
 * its own process.
 *
 *     sweepctl-core: signal 11
 *     sweepctl-core: 0x1a2b FILE
 *
 * The address is relative to the file, as addr2line requires. The signal then ends the process. */
#define _GNU_SOURCE
#include "chip.h"

#if defined(__GLIBC__) || defined(__APPLE__)
#include <dlfcn.h>
#include <execinfo.h>
#include <signal.h>
#include <string.h>
#include <unistd.h>

#define FRAMES_MAX 64
#define HANDLERS_FRAMES 2 /* frames of the handler, and of the system function that calls it */
#define STACK_BYTES 65536u /* separate stack of the handler, because the program's stack may have
                              overflowed */
#define TAG "sweepctl-core: "

static const int numbers[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
static uint8_t handlers_stack[STACK_BYTES];

static void write_text(const char *text)
{
    const ssize_t written = write(STDERR_FILENO, text, strlen(text));
    (void)written;
}

static void write_number(uint64_t value, unsigned base)
{
    static const char digits[] = "0123456789abcdef";
    char text[24];
    char *at = text + sizeof text - 1;
    *at = '\0';
    do {
        *--at = digits[value % base];
        value /= base;
    } while (value != 0);
    write_text(at);
}

static void on_signal(int number)
{
    void *frames[FRAMES_MAX];
    Dl_info own, found;
    const int count = backtrace(frames, FRAMES_MAX);
    const bool known = dladdr((void *)(uintptr_t)chip_call, &own) != 0;
    write_text(TAG "signal ");
    write_number((uint64_t)number, 10);
    write_text("\n");
    for (int i = HANDLERS_FRAMES; i < count; i++) {
        if (dladdr(frames[i], &found) == 0 || found.dli_fname == NULL) {
            continue;
        }
        if (known && found.dli_fbase == own.dli_fbase) {
            break; /* the caller of the program */
        }
        write_text(TAG "0x");
        write_number((uint64_t)((uintptr_t)frames[i] - (uintptr_t)found.dli_fbase), 16);
        write_text(" ");
        write_text(found.dli_fname);
        write_text("\n");
    }
    (void)signal(number, SIG_DFL);
    (void)raise(number);
}

void chip_catch_signals(void)
{
    void *frame[1];
    struct sigaction action;
    const stack_t stack = {.ss_sp = handlers_stack, .ss_size = sizeof handlers_stack};
    (void)backtrace(frame, 1); /* loads its library now, not in a signal handler */
    (void)sigaltstack(&stack, NULL);
    memset(&action, 0, sizeof action);
    action.sa_handler = on_signal;
    action.sa_flags = SA_ONSTACK | SA_NODEFER;
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        (void)sigaction(numbers[i], &action, NULL);
    }
}

#else

void chip_catch_signals(void)
{
}

#endif
