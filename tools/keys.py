"""One key stops the robot: a thread that reads the terminal a character at a time."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@contextlib.contextmanager
def on_key(keys: str, action: Callable[[], None]) -> Iterator[None]:
    """Call ``action`` when one of ``keys`` is pressed; does nothing without a terminal."""
    if not sys.stdin.isatty() or sys.platform == "win32":
        yield
        return
    import termios
    import tty

    fd = sys.stdin.fileno()
    before = termios.tcgetattr(fd)
    end_read, end_write = os.pipe()

    def watch() -> None:
        while True:
            ready, _, _ = select.select([fd, end_read], [], [])
            if end_read in ready:
                return
            pressed = os.read(fd, 1).decode("latin-1")
            if not pressed:
                return
            if pressed in keys:
                action()

    thread = threading.Thread(target=watch, name="keys", daemon=True)
    tty.setcbreak(fd)  # leaves Ctrl-C a signal
    thread.start()
    try:
        yield
    finally:
        os.write(end_write, b"!")
        thread.join(timeout=1.0)
        termios.tcsetattr(fd, termios.TCSADRAIN, before)
        os.close(end_read)
        os.close(end_write)
