"""Keys of a terminal as events: key presses, and key releases if the terminal reports them.

Releases need the kitty keyboard protocol (progressive enhancement of its specification). To find
out if a terminal supports the protocol, the query ``CSI ? u`` is sent, and then a request for the
terminal's attributes (``CSI c``), which every terminal answers. If the terminal also answers the
query, it supports the protocol, and is set to report presses, repeats and releases of all keys. At
the end the setting is restored.
"""

from __future__ import annotations

import os
import re
import sys
import threading
from typing import TYPE_CHECKING, NamedTuple, Self

from bridge.io.readable import readable
from tools.cli.console import send
from tools.cli.output_queue import QueuedStream

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

QUERY = "\x1b[?u\x1b[c"
"""Query of the keyboard protocol, then of the terminal's attributes."""
ENTER = "\x1b[>11u"
"""Push flags: disambiguate (1), report event types (2), report all keys as escape codes (8)."""
LEAVE = "\x1b[<u"
"""Pop the flags."""
ANSWER_S = 0.3
"""Maximum time to wait for the terminal's answer, s."""
_ESCAPE_S = 0.05
"""Time after which a single escape byte is the escape key, s. A sequence arrives at once."""
_CSI = re.compile(rb"\x1b\[([<>?]?)([0-9;:]*)([A-Za-z~])")
_SS3 = re.compile(rb"\x1bO([A-Za-z])")
_LETTERS = {"A": "up", "B": "down", "C": "right", "D": "left", "H": "home", "F": "end"}
_CODES = {27: "escape", 13: "enter", 9: "tab", 32: "space", 127: "backspace"}
_KINDS = {"1": "press", "2": "repeat", "3": "release"}
_CONTROL = 4
"""Bit of the control key in the modifiers. The terminal sends the modifiers plus one."""


class Key(NamedTuple):
    """One event of one key."""

    name: str
    """``a``, ``space``, ``up``, ``escape``, ``ctrl+c``."""
    kind: str = "press"
    """``press``, ``repeat`` or ``release``."""


class KeyDecoder:
    """Decodes a terminal's bytes into keys; stores an incomplete sequence until it is complete."""

    def __init__(self) -> None:
        self._rest = b""
        self.kitty = False
        """The terminal supports the keyboard protocol."""
        self.answered = False
        """The terminal has answered the request for its attributes."""

    def feed(self, data: bytes) -> list[Key]:
        """Decode bytes and return the complete keys."""
        self._rest += data
        keys: list[Key] = []
        while self._rest:
            key, taken = self._next()
            if taken == 0:
                break
            self._rest = self._rest[taken:]
            if key is not None:
                keys.append(key)
        return keys

    @property
    def waiting(self) -> bool:
        """Whether an incomplete sequence is stored."""
        return bool(self._rest)

    def flush(self) -> list[Key]:
        """Drop an incomplete sequence; a single escape byte is the escape key."""
        rest, self._rest = self._rest, b""
        return [Key("escape")] if rest == b"\x1b" else []

    def _next(self) -> tuple[Key | None, int]:
        data = self._rest
        if data[0] != 0x1B:  # noqa: PLR2004 - an escape sequence
            return _plain(data)
        found = _CSI.match(data)
        if found is not None:
            return self._csi(found), found.end()
        found = _SS3.match(data)
        if found is not None:
            name = _LETTERS.get(found[1].decode())
            return (Key(name) if name else None), found.end()
        if len(data) == 1 or data[1:2] in {b"[", b"O"}:
            return None, len(data) if len(data) > 32 else 0  # noqa: PLR2004 - longer than any
        return Key("escape"), 1

    def _csi(self, found: re.Match[bytes]) -> Key | None:
        private, arguments, letter = (part.decode() for part in found.groups())
        if private:
            self.kitty = self.kitty or (private, letter) == ("?", "u")
            self.answered = self.answered or letter == "c"
            return None
        fields = [part.split(":") for part in arguments.split(";")]
        modifiers, kind = "1", "1"
        if len(fields) > 1:
            modifiers = fields[1][0] or "1"
            kind = fields[1][1] if len(fields[1]) > 1 else "1"
        name = _named(fields[0][0]) if letter == "u" else _LETTERS.get(letter)
        if name is None:
            return None
        control = modifiers.isdigit() and (int(modifiers) - 1) & _CONTROL
        return Key(f"ctrl+{name}" if control else name, _KINDS.get(kind, "press"))


def _named(code: str) -> str | None:
    if not code.isdigit() or not 0 < int(code) <= sys.maxunicode:
        return None
    number = int(code)
    if number in _CODES:
        return _CODES[number]
    if 57344 <= number <= 63743:  # noqa: PLR2004 - the private area: modifiers and keypads
        return None
    return chr(number).lower()


def _plain(data: bytes) -> tuple[Key | None, int]:
    first = data[0]
    if first < 0x20:  # noqa: PLR2004 - controls
        if first in _CODES:
            return Key(_CODES[first]), 1
        return Key("enter" if first == 10 else f"ctrl+{chr(first + 96)}"), 1  # noqa: PLR2004 - LF
    if first in _CODES:
        return Key(_CODES[first]), 1
    if first < 0x80:  # noqa: PLR2004 - ASCII
        return Key(chr(first).lower()), 1
    length = 2 if first < 0xE0 else 3 if first < 0xF0 else 4  # noqa: PLR2004 - UTF-8's lead bytes
    if len(data) < length:
        return None, 0
    text = data[:length].decode("utf-8", "ignore")
    return (Key(text) if text else None), length


class Keyboard:
    """Reads the keys of this terminal in a thread; a context manager that restores the terminal."""

    def __init__(self, on_key: Callable[[Key], None], *, releases: bool = True) -> None:
        """Call ``on_key`` for each key; with ``releases`` ask the terminal to report releases."""
        self._on_key = on_key
        self._ask = releases
        self._decoder = KeyDecoder()
        self.releases = False
        """Whether the terminal reports releases; valid after ``__enter__``."""
        self._thread: threading.Thread | None = None

    @staticmethod
    def possible() -> bool:
        """Return whether stdin is a terminal whose keys can be read."""
        return sys.stdin.isatty() and sys.platform != "win32"

    def __enter__(self) -> Self:
        """Begin to read keys; do nothing if stdin is not a terminal."""
        if not self.possible():
            return self
        import termios
        import tty

        self._in = sys.stdin.fileno()
        # Queued, because a write to a terminal that is paused or hangs would block.
        self._out = None if sys.stderr.isatty() else QueuedStream(sys.stdin)
        self._before = termios.tcgetattr(self._in)
        self._end_read, self._end_write = os.pipe()
        # Ctrl-C remains a signal. TCSANOW, because other modes would wait for the terminal.
        tty.setcbreak(self._in, termios.TCSANOW)
        termios.tcflush(self._in, termios.TCIFLUSH)
        if self._ask:
            self._learn()
        self._thread = threading.Thread(target=self._watch, name="keys", daemon=True)
        self._thread.start()
        return self

    def _learn(self) -> None:
        self._send(QUERY)
        while not self._decoder.answered:
            ready = readable([self._in], ANSWER_S)
            if not ready:
                break
            for key in self._decoder.feed(os.read(self._in, 256)):
                self._on_key(key)
        self.releases = self._decoder.kitty
        if self.releases:
            self._send(ENTER)

    def _send(self, sequence: str) -> None:
        if self._out is None:
            send(sequence)
        else:
            self._out.write(sequence)

    def _watch(self) -> None:
        decoder = self._decoder
        while True:
            wait_s = _ESCAPE_S if decoder.waiting else None
            ready = readable([self._in, self._end_read], wait_s)
            if self._end_read in ready:
                return
            if ready:
                try:
                    data = os.read(self._in, 256)
                except OSError:  # the terminal was closed; SIGHUP ends the run
                    return
                if not data:
                    return
                keys = decoder.feed(data)
            else:
                keys = decoder.flush()
            for key in keys:
                self._on_key(key)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Restore the terminal."""
        if self._thread is None:
            return
        import contextlib
        import termios

        os.write(self._end_write, b"!")
        self._thread.join(timeout=1.0)
        with contextlib.suppress(OSError, termios.error):
            if self.releases:
                self._send(LEAVE)
            if self._out is not None:
                self._out.drain()
            termios.tcsetattr(self._in, termios.TCSANOW, self._before)
        os.close(self._end_read)
        os.close(self._end_write)
