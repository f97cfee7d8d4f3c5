"""A command on a pseudo-terminal: the test sends keys and reads the screen."""

from __future__ import annotations

import os
import pty
import select
import subprocess
import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Self

from support.processes import COMMAND, environment

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

PATIENCE_S = 60.0
ASKED = b"\x1b[?u"
KITTY_REPLY, XTERM_REPLY = b"\x1b[?0u\x1b[?62;c", b"\x1b[?64;1;2c"


class OnTerminal:
    """``sweepctl`` with stdin, stdout and stderr on a pty of 120 × 40 characters.

    With ``kitty`` the terminal also reports key releases, as the kitty keyboard protocol defines.
    """

    def __init__(
        self,
        *arguments: str | Path,
        cwd: Path,
        kitty: bool = False,
        term: str = "xterm-256color",
        **variables: str,
    ) -> None:
        self._master, slave = pty.openpty()
        self.drawn = b""
        self._reads = threading.Event()
        self._reads.set()
        self._kitty = kitty
        self.process = subprocess.Popen(
            [*COMMAND, *map(str, arguments)],
            cwd=cwd,
            env=environment(TERM=term, COLUMNS="120", LINES="40", **variables),
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
        )
        os.close(slave)
        self._news = threading.Condition()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        answered = False
        while True:
            if not (self._reads.wait(0.2) and select.select([self._master], [], [], 0.2)[0]):
                if self.process.poll() is not None:
                    return
                continue
            try:
                data = os.read(self._master, 65536)
            except OSError:  # the other end of the pty is closed
                return
            with self._news:
                self.drawn += data
                self._news.notify_all()
            if not answered and ASKED in self.drawn:
                answered = True
                os.write(self._master, KITTY_REPLY if self._kitty else XTERM_REPLY)

    def shows(self, text: str) -> None:
        """Wait until the screen contained this text."""
        with self._news:
            found = self._news.wait_for(lambda: text.encode() in self.drawn, PATIENCE_S)
        assert found, self.drawn[-3000:].decode("utf-8", "replace")

    def stand_still(self) -> None:
        """Stop reading, as a terminal does if its window hangs."""
        self._reads.clear()

    def hold(self) -> None:
        """Pause the command's output, as Ctrl-S does."""
        os.write(self._master, b"\x13")

    def resume(self) -> None:
        """Resume the command's output, as Ctrl-Q does."""
        self._reads.set()

    def press(self, data: bytes) -> None:
        os.write(self._master, data)

    def end(self) -> int:
        """Wait until the command ends; return its exit status."""
        status = self.process.wait(PATIENCE_S)
        self._thread.join(PATIENCE_S)
        return status

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self._thread.join(PATIENCE_S)
        with suppress(OSError):
            os.close(self._master)
