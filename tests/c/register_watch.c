/* Watches each access to a page of simulated registers. The page is protected, so an access causes a
 * SIGSEGV. Its handler allows the access and sets the processor's trap flag. The SIGTRAP after this
 * one instruction protects the page again. */
#define _GNU_SOURCE
#include "register_watch.h"

#include <signal.h>
#include <stddef.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <ucontext.h>

#if defined(__x86_64__)

#define PAGE 0x1000u
#define TRAP_FLAG 0x100
#define WRITE_ACCESS 2 /* bit of the page fault's error code */

static uintptr_t watched, accessed;
static bool written;
static void (*after_access)(uintptr_t, bool);

static void protect(int allowed)
{
    if (mprotect((void *)watched, PAGE, allowed) != 0) {
        abort();
    }
}

static void before(int number, siginfo_t *info, void *context)
{
    ucontext_t *const state = context;
    accessed = (uintptr_t)info->si_addr;
    if (after_access == NULL || accessed - watched >= PAGE) {
        signal(number, SIG_DFL); /* an error of the program: it ends when it repeats the access */
        return;
    }
    written = (state->uc_mcontext.gregs[REG_ERR] & WRITE_ACCESS) != 0;
    protect(PROT_READ | PROT_WRITE);
    state->uc_mcontext.gregs[REG_EFL] |= TRAP_FLAG;
}

static void after(int number, siginfo_t *info, void *context)
{
    ucontext_t *const state = context;
    (void)number;
    (void)info;
    state->uc_mcontext.gregs[REG_EFL] &= ~TRAP_FLAG;
    after_access(accessed, written);
    protect(PROT_NONE);
}

bool watch_registers(uintptr_t address, void (*call)(uintptr_t address, bool write))
{
    struct sigaction segv = {.sa_sigaction = before, .sa_flags = SA_SIGINFO};
    struct sigaction trap = {.sa_sigaction = after, .sa_flags = SA_SIGINFO};
    if (after_access != NULL) {
        protect(PROT_READ | PROT_WRITE);
    }
    watched = address & ~(uintptr_t)(PAGE - 1u);
    after_access = call;
    if (call != NULL) {
        sigaction(SIGSEGV, &segv, NULL);
        sigaction(SIGTRAP, &trap, NULL);
        protect(PROT_NONE);
    }
    return true;
}

#else

bool watch_registers(uintptr_t address, void (*call)(uintptr_t address, bool write))
{
    (void)address;
    (void)call;
    return false;
}

#endif
