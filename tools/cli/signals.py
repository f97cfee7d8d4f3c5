"""Signals that end a command in order."""

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
    """Signals that end a command: Ctrl-C, a request to terminate, and the loss of the terminal.

    Not the last one where it is ignored: ``nohup`` asks for that.
    """
    numbers = [signal.SIGINT, signal.SIGTERM]
    if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    return numbers


@contextlib.contextmanager
def until_signalled(end: Callable[[], None]) -> Iterator[None]:
    """Call ``end`` at a signal that ends a command."""
    before = {number: signal.signal(number, lambda _n, _f: end()) for number in ending_signals()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def held_back() -> Iterator[None]:
    """Processes that this thread begins meanwhile do not get the signals that end a command yet.

    A process begins with what its thread holds back, and lets them come with :func:`let_come` when
    it knows what to do about them: before that they would end it with a traceback, or silently.
    Another thread of ours may get them, for whose handler it makes no difference.
    """
    if sys.platform == "win32":  # signals cannot be held back there
        yield
        return
    resource_tracker.ensure_running()  # it lets them come again if it begins its process meanwhile
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def let_come() -> None:
    """Let the signals come that were held back as this process began."""
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)


@contextlib.contextmanager
def leaving_at_once(text: str) -> Iterator[None]:
    """Meanwhile a signal ends the process there and then, with a line on stderr and status 1.

    For work that can be done again. An exception out of a signal's handler can come in the
    middle of loading an extension module, which the interpreter does not survive.
    """

    def leave() -> None:
        # The terminal may be what went away, or what does not read.
        with contextlib.suppress(OSError, ValueError):
            if select.select([], [2], [], 0.0)[1]:
                os.write(2, f"{text}\n".encode())
        os._exit(1)

    with until_signalled(leave):
        yield
