/* script_host: reads a script from stdin and writes its results to stdout, step by step. */
#define _POSIX_C_SOURCE 200809L
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "script.h"

static void to_stdout(void *to, const uint8_t *data, size_t length)
{
    (void)to;
    if (length != 0 && fwrite(data, 1, length, stdout) != length) {
        exit(1);
    }
}

int main(void)
{
    static uint8_t script[2u * SCRIPT_RECORD_MAX];
    size_t waiting = 0;
    ssize_t got;
    script_begin(UINT64_MAX);
    while ((got = read(STDIN_FILENO, script + waiting, sizeof script - waiting)) > 0) {
        waiting += (size_t)got;
        const size_t taken = script_take(script, waiting, to_stdout, NULL);
        waiting -= taken;
        memmove(script, script + taken, waiting);
        (void)fflush(stdout);
    }
    return got == 0 ? 0 : 1;
}
