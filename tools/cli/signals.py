"""Handling of the signals that end a command."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
from multiprocessing import resource_tracker
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_ENDING = {signal.SIGINT, signal.SIGTERM}
if sys.platform != "win32":
    _ENDING.add(signal.SIGHUP)


def ending_signals() -> list[signal.Signals]:
    """Return the signals that end a command: SIGINT, SIGTERM and SIGHUP.

    SIGHUP is not included if it is ignored, for example because of ``nohup``.
    """
    numbers = [signal.SIGINT, signal.SIGTERM]
    if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    return numbers


@contextlib.contextmanager
def until_signalled(end: Callable[[], None]) -> Iterator[None]:
    """Call ``end`` at each signal that ends a command."""
    before = {number: signal.signal(number, lambda _n, _f: end()) for number in ending_signals()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def signals_blocked() -> Iterator[None]:
    """Block the ending signals in processes that this thread starts in the meantime.

    A child process inherits the blocked signals. It calls :func:`unblock_signals` after its
    handlers are installed. An earlier signal would end the child silently or with a traceback.
    Other threads of this process may still get the signals; the handlers run all the same.
    """
    if sys.platform == "win32":  # Windows cannot block signals
        yield
        return
    resource_tracker.ensure_running()  # if it started later, it would unblock the signals
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def unblock_signals() -> None:
    """Unblock the signals that :func:`signals_blocked` blocked when this process started."""
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)


@contextlib.contextmanager
def leaving_at_once(text: str) -> Iterator[None]:
    """Make an ending signal print ``text`` and end the process at once with status 1.

    For work that can be repeated. An exception from a signal handler is no alternative: it can
    interrupt the loading of an extension module, which crashes the interpreter.
    """

    def leave() -> None:
        # The terminal may be closed, or not reading.
        with contextlib.suppress(OSError, ValueError):
            if select.select([], [2], [], 0.0)[1]:
                os.write(2, f"{text}\n".encode())
        os._exit(1)

    with until_signalled(leave):
        yield
