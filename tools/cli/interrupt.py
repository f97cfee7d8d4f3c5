"""Ctrl-C while the command starts: put off until no import is cut short.

A ``KeyboardInterrupt`` inside of an import ends in a traceback, and inside of an extension
module's in worse. A Ctrl-C that comes then is put off until the import is done.
"""

from __future__ import annotations

import os
import signal
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from types import FrameType

_AGAIN_S = 0.02
"""Time after which a signal that came within an import comes again, seconds."""
_MAX_TIMES = 250
"""Times that one is put off: 5 s, after which the import hangs."""

_LOADER = "importlib._bootstrap"
"""Beginning of the names of modules that load code, which an exception would leave half done."""

_put_off = 0
_has_begun = False
_is_done = False


def install() -> None:
    """Take Ctrl-C, where Python's own handler has it."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupted)


def begin() -> None:
    """From now on Ctrl-C raises ``KeyboardInterrupt``: all is imported, and it is caught."""
    global _has_begun  # noqa: PLW0603 - the handler of a signal gets nothing else to look at
    _has_begun = True


def set_done(*, done: bool = True) -> None:
    """From now on Ctrl-C takes nothing back: what was asked for is confirmed and reported."""
    global _is_done  # noqa: PLW0603 - as above
    _is_done = done


def is_done() -> bool:
    """Whether what was asked for is confirmed and reported."""
    return _is_done


def interrupted(_number: int, frame: FrameType | None) -> None:
    """Raise ``KeyboardInterrupt``, where that is caught and no loading of code is cut off."""
    global _put_off  # noqa: PLW0603 - as above
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
