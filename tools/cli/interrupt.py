"""Handler for Ctrl-C that waits until no import is in progress.

A ``KeyboardInterrupt`` during an import prints a traceback. During the import of an extension
module it can crash the interpreter. So the handler defers a Ctrl-C until the import is done.
"""

from __future__ import annotations

import os
import signal
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from types import FrameType

_AGAIN_S = 0.02
"""Delay after which a deferred signal is sent again, s."""
_MAX_TIMES = 250
"""Maximum number of times that a signal is deferred: 5 s in total. After this time the import is
assumed to hang."""

_LOADER = "importlib._bootstrap"
"""Prefix of the names of the modules that load code, which must not be interrupted."""

_put_off = 0
_has_begun = False
_is_done = False


def install() -> None:
    """Install the handler for Ctrl-C, if Python's own handler is installed."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupted)


def begin() -> None:
    """Make Ctrl-C raise ``KeyboardInterrupt`` from now on; ``main`` catches the exception."""
    global _has_begun  # noqa: PLW0603 - a signal handler gets no argument of ours
    _has_begun = True


def set_done(*, done: bool = True) -> None:
    """Record that the device has confirmed the command, and that the result is printed.

    Ctrl-C then still ends the process, but with exit status 0.
    """
    global _is_done  # noqa: PLW0603 - a signal handler gets no argument of ours
    _is_done = done


def is_done() -> bool:
    """Return whether the command's work is confirmed and reported."""
    return _is_done


def interrupted(_number: int, frame: FrameType | None) -> None:
    """Raise ``KeyboardInterrupt``, or defer the signal while code is being imported."""
    global _put_off  # noqa: PLW0603 - a signal handler gets no argument of ours
    if _has_begun and not _loads(frame):
        raise KeyboardInterrupt
    _put_off += 1
    if _put_off > _MAX_TIMES:
        os._exit(1)
    again = threading.Timer(_AGAIN_S, os.kill, (os.getpid(), signal.SIGINT))
    again.daemon = True
    again.start()


def _loads(frame: FrameType | None) -> bool:
    while frame is not None:
        if str(frame.f_globals.get("__name__")).startswith(_LOADER):
            return True
        frame = frame.f_back
    return False
