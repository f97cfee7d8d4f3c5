"""``--target core``: the C core, or a user's library, on a virtual board."""

from __future__ import annotations

import os
import sys
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sim_device.core.chip import Chip
    from sim_device.core.core_sweeper import CoreSweeper
    from tools.virtual.wanted import Wanted

DEBUGGER = Path("/proc/self/status")
"""File in which Linux shows whether a debugger has attached."""


def check(target: str, firmware: Path | None, *, gdb: bool, in_real_time: bool = True) -> None:
    """Check that the options of the target can be combined.

    Raises:
        click.UsageError: the options cannot be combined.

    """
    if target == "qemu" and not in_real_time:
        raise click.UsageError("QEMU runs in real time: use `sweepctl emulate --target qemu`")
    if firmware is not None and target == "python":
        raise click.UsageError("--firmware needs --target core or --target qemu")
    if not gdb:
        return
    if target != "core":
        raise click.UsageError("--gdb needs --target core")
    if not DEBUGGER.exists():
        raise click.UsageError("--gdb needs Linux")


def device(
    wanted: Wanted,
    firmware: Path | None,
    notify: Callable[[str], None],
    ended: Callable[[], object],
    *,
    gdb: bool = False,
) -> CoreSweeper:
    """Make a device; the caller closes it.

    Args:
        wanted: properties of the device.
        firmware: shared library to run, in a separate process; None: the C core of sweepctl, in
            this process.
        notify: prints a message.
        ended: returns a true value if a signal has ended the command.
        gdb: wait for a debugger before the first boot.

    Raises:
        click.BadParameter: ``firmware`` is no firmware library.
        BridgeError: the firmware crashed while it was loaded or booted.
        KeyboardInterrupt: a signal ended the wait for the debugger.

    """
    from bridge.errors import BridgeError
    from sim_device.core.chip import FirmwareCrashError, FirmwareLibraryError

    def started(pid: int) -> None:
        if gdb:
            _await_debugger(notify, pid, ended)

    try:
        return make(wanted, firmware, started, debugged=gdb)
    except FirmwareLibraryError as error:
        raise click.BadParameter(str(error), param_hint="'--firmware'") from None
    except FirmwareCrashError as error:
        print_trace(error)
        raise BridgeError(str(error)) from None


def make(
    wanted: Wanted,
    firmware: Path | None,
    started: Callable[[int], None] = lambda _pid: None,
    *,
    debugged: bool = False,
) -> CoreSweeper:
    """Make a device; the caller closes it.

    Args:
        wanted: properties of the device.
        firmware: shared library to run, in a separate process; None: the C core of sweepctl, in
            this process.
        started: called with the id of the process that runs the firmware, before its first boot.
        debugged: no time limit for a call of the firmware, because a debugger may stop it.

    Raises:
        FirmwareLibraryError: ``firmware`` is no firmware library.
        FirmwareCrashError: the firmware crashed while it was loaded or booted.

    """
    from sim_device.core.chip import LocalChip
    from sim_device.core.core_sweeper import CoreSweeper
    from sim_device.ports.core_process import CoreProcess

    def make_chip(answer: Callable[[int], bytes]) -> Chip:
        if firmware is not None:
            return CoreProcess(answer, firmware, debugged=debugged, started=started)
        chip = LocalChip(answer)
        started(os.getpid())  # the core is loaded, so a debugger finds its functions
        return chip

    return CoreSweeper(
        wanted.plan,
        wanted.model,
        seed=wanted.seed,
        noise=wanted.noise,
        node=wanted.node,
        boot_id=wanted.boot_id,
        link=wanted.link,
        local=wanted.local,
        key=wanted.key,
        make_chip=make_chip,
    )


@contextmanager
def running(  # noqa: PLR0913 - how the device is made
    target: str,
    wanted: Wanted,
    firmware: Path | None,
    notify: Callable[[str], None],
    ended: Callable[[], object],
    *,
    gdb: bool,
) -> Iterator[CoreSweeper | None]:
    """Make the device of ``--target core`` and close it at the end; None with another target."""
    if target != "core":
        yield None
        return
    with closing(device(wanted, firmware, notify, ended, gdb=gdb)) as made:
        yield made


def print_trace(error: Exception) -> None:
    """Print the backtrace of a firmware's crash; other errors have no backtrace."""
    from sim_device.core.chip import FirmwareCrashError
    from tools.cli.console import inform

    for line in error.trace if isinstance(error, FirmwareCrashError) else []:
        inform(f"  {line}")


def _await_debugger(notify: Callable[[str], None], pid: int, ended: Callable[[], object]) -> None:
    """Print the command that attaches a debugger, and wait until a debugger has attached."""
    from sim_device.ports.core_process import await_debugger

    program = sys.executable
    notify(f"waiting for a debugger: gdb {program} {pid} -ex 'break firmware_boot' -ex continue")
    await_debugger(pid, ended)
