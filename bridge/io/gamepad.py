"""Gamepad through Linux' joystick interface (Documentation/input/joydev/joystick-api.rst).

Each event has 8 bytes: time in ms (u32), value (s16), type (u8), number (u8). The type is 1 for a
button and 2 for an axis. Events with the state at opening have 0x80 added to their type.
"""

from __future__ import annotations

import errno
import os
import struct
import threading
from typing import TYPE_CHECKING, NamedTuple, Self

from bridge.errors import PortError
from bridge.io import clock
from bridge.io.readable import readable

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

EVENT = struct.Struct("<IhBB")
"""Layout of an event: time, value, type, number."""
BUTTON, AXIS, INITIAL = 0x01, 0x02, 0x80
FULL = 32767.0
"""Value of a full deflection."""
DEAD_SHARE = 0.12
"""Dead zone, as a share of the full deflection. The value of a stick at rest is up to 0.1."""
REPEAT_S = 0.1
"""Interval of repeated stick reports, s. The interface itself reports changes only."""
SILENT_S = 3.0
"""Time without an event after which the sticks count as released, s. A wireless pad that has lost
its link sends nothing, but its device file stays for some time."""


_GET_VERSION = 0x8004_6A01
"""Request JSIOCGVERSION of the joystick interface; only joystick devices answer it."""


def open_joystick(path: str) -> int:
    """Open a joystick device and return its file descriptor.

    Raises:
        PortError: the device does not exist, cannot be read, or is no joystick.

    """
    import fcntl  # noqa: PLC0415 - Windows has none

    try:
        fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except OSError as error:
        why = "plug in the gamepad" if error.errno == errno.ENOENT else error.strerror
        raise PortError(f"cannot open gamepad {path}: {why}") from None
    try:
        fcntl.ioctl(fd, _GET_VERSION, bytes(4))
    except OSError:
        os.close(fd)
        raise PortError(f"{path} is no gamepad; give a joystick such as /dev/input/js0") from None
    return fd


class PadLayout(NamedTuple):
    """Numbers of axes and buttons. The defaults fit most pads with Linux' xpad and hid drivers."""

    ahead_axis: int = 1
    """Axis for forward motion: left stick, vertical; up is negative."""
    turn_axis: int = 0
    dead_man: int = 4
    """Button for the dead-man switch: left shoulder button."""
    stop: int = 1
    """Button for the stop: B or circle button."""


class Sticks(NamedTuple):
    """Position of the sticks, -1..1, and the dead-man button."""

    ahead: float
    turn: float
    held: bool


class PadState:
    """Converts events to stick positions. No I/O."""

    def __init__(self, layout: PadLayout) -> None:
        self._layout = layout
        self._axes: dict[int, float] = {}
        self._buttons: dict[int, bool] = {}
        self._rest = b""

    def feed(self, data: bytes) -> bool:
        """Handle bytes of the device; return True if the stop button was pressed."""
        self._rest += data
        stopped = False
        while len(self._rest) >= EVENT.size:
            _, value, kind, number = EVENT.unpack_from(self._rest)
            self._rest = self._rest[EVENT.size :]
            if kind & ~INITIAL == AXIS:
                self._axes[number] = max(-1.0, min(1.0, value / FULL))
            elif kind & ~INITIAL == BUTTON:
                self._buttons[number] = bool(value)
                stopped = stopped or (
                    number == self._layout.stop and bool(value) and not kind & INITIAL
                )
        return stopped

    @property
    def sticks(self) -> Sticks:
        """Forward, turn (counter-clockwise positive), and state of the dead-man button."""
        layout = self._layout
        return Sticks(
            _live(-self._axes.get(layout.ahead_axis, 0.0)),
            _live(-self._axes.get(layout.turn_axis, 0.0)),
            self._buttons.get(layout.dead_man, False),
        )


def _live(value: float) -> float:
    """Remove the dead zone, and rescale the value so that its range starts at 0."""
    size = abs(value)
    if size <= DEAD_SHARE:
        return 0.0
    return (size - DEAD_SHARE) / (1.0 - DEAD_SHARE) * (1.0 if value > 0.0 else -1.0)


class Gamepad:
    """Reads a joystick device in its own thread. Use it as a context manager."""

    def __init__(
        self,
        path: str,
        on_sticks: Callable[[Sticks], None],
        on_stop: Callable[[], None],
        layout: PadLayout | None = None,
        on_gone: Callable[[], None] = lambda: None,
    ) -> None:
        """Open the device.

        Args:
            path: Device file, for example ``/dev/input/js0``.
            on_sticks: Called at each change, and ten times per second while a stick is held.
            on_stop: Called when the stop button is pressed.
            layout: Numbers of axes and buttons.
            on_gone: Called after the device was removed; this also releases all sticks.

        Raises:
            PortError: the device does not exist, cannot be read, or is no joystick.

        """
        self._on_sticks, self._on_stop, self._on_gone = on_sticks, on_stop, on_gone
        self._state = PadState(layout or PadLayout())
        self._fd = open_joystick(path)
        self._event_ns = clock.now()
        """Time of the newest event of the device, ns."""
        self._end_read, self._end_write = os.pipe()
        self._thread = threading.Thread(target=self._run, name="gamepad", daemon=True)

    def _run(self) -> None:
        while True:
            ready = readable([self._fd, self._end_read], REPEAT_S)
            if self._end_read in ready:
                return
            if ready:
                try:
                    data = os.read(self._fd, 64 * EVENT.size)
                except BlockingIOError:
                    continue
                except OSError:
                    data = b""
                if not data:  # unplugged
                    self._on_sticks(Sticks(0.0, 0.0, held=False))
                    self._on_gone()
                    return
                self._event_ns = clock.now()
                if self._state.feed(data):
                    self._on_stop()
            elif not self._state.sticks.held:
                continue
            silent = clock.now() - self._event_ns > SILENT_S * 1e9
            self._on_sticks(Sticks(0.0, 0.0, held=False) if silent else self._state.sticks)

    def __enter__(self) -> Self:
        """Start to read."""
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop reading and close the device."""
        os.write(self._end_write, b"!")
        self._thread.join(timeout=1.0)
        for fd in (self._fd, self._end_read, self._end_write):
            os.close(fd)
