"""The C firmware on a virtual board, from a boot of the simulated chip to its next reset."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, NamedTuple

from protocol.messages.values import Fault, Mode, RebootKind, StopCause
from sim_device.core.chip import PAYLOAD_MAX, Ask, Operation
from sim_device.device.latch import StopLatch
from sim_device.device.modes import MODE_OF, DeviceState
from sim_device.line.line import NO_LIMIT
from sim_device.sensors.units import contact_bits, milli, range_steps

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim_device.core.chip import Chip
    from sim_device.device.identity import Identity
    from sim_device.sensors.sensors import SensorSuite

# Payloads, replies and answers, in the layout of ``chip.h``.
BOOT = struct.Struct("<12sIBB?BH?x4I")
POLL = struct.Struct("<QI2B?xH2H?7h")
RECEIVE = struct.Struct("<QI2B?xH")
_REPLY = struct.Struct("<2h??BBB??B?HIIq")
RANGES = struct.Struct("<3HI")
POWER = struct.Struct("<4H")
DUTY_ONE = 10_000
"""Number of steps of a full duty."""
PAGES, PAGE_SIZE = 2, 1024
"""Number of flash pages for the settings, and their size, bytes."""
NO_CLOCK, REMOTE = 1, 4
"""``BOARD_TROUBLE_CLOCK`` and ``BOARD_TROUBLE_REMOTE`` of ``board.h``."""
_ROOM = PAYLOAD_MAX - RECEIVE.size
STATES = (
    DeviceState.STOPPED,
    DeviceState.IDLE,
    DeviceState.VELOCITY,
    DeviceState.BRINGUP,
    DeviceState.ONBOARD,
    DeviceState.RUNNING,
    DeviceState.PAUSED,
)
"""Device state for each mode number in ``core/modes.h``."""


class View(NamedTuple):
    """State that the chip reports after each call."""

    left: int
    """Left duty, in units of ``DUTY_ONE``."""
    right: int
    drivers: bool
    rebooted: bool
    """True if the program requests a reset."""
    fed: int
    """True if the program fed the watchdog in this call."""
    state: int
    stop_cause: int
    negotiated: bool
    keyed: bool
    """True if the program accepts only signed commands."""
    flash_busy: int
    blocked: bool
    """True if frames wait for the bus."""
    faults: int
    session_id: int
    waited_us: int
    """Time for which the program has blocked its main loop, µs."""
    due_us: int
    """Uptime of the program's next control period, µs."""


def view_of(reply: bytes) -> tuple[View, bytes]:
    """Split a reply into the chip's state and the bytes that the chip has sent."""
    return View._make(_REPLY.unpack_from(reply)), reply[_REPLY.size :]


class LineState(NamedTuple):
    """State of the chip's end of the link."""

    room: int = NO_LIMIT
    """Free space of the link: bytes on a serial link, frames on a CAN bus."""
    send_errors: int = 0
    receive_errors: int = 0
    off: bool = False
    """True if the CAN controller is in the bus-off state."""
    offs: int = 0
    """Number of bus-off events since the boot."""


class CoreFirmware:
    """One run of the program on a chip, from a boot to the next reset."""

    def __init__(  # noqa: PLR0913 - one parameter per input of a boot
        self,
        chip: Chip,
        sensors: SensorSuite,
        identity: Identity,
        *,
        can: bool,
        local: bool = True,
        line: Callable[[], LineState] = LineState,
    ) -> None:
        """Boot.

        Args:
            chip: the virtual board.
            sensors: the sensors.
            identity: the identity that the device reports.
            can: whether the link to the host is a CAN bus instead of a UART.
            local: whether only a person beside the robot can use the UART.
            line: returns the present state of the link.

        """
        self._chip, self._sensors, self._line = chip, sensors, line
        self._imu_samples = 0
        self._out = b""
        self.identity = identity
        self.reboot_wanted: RebootKind | None = None
        """Reset that the program has requested; None: no request. A factory reset is already
        executed."""
        crash = identity.crash
        self.view = self._take(
            chip.call(
                Operation.BOOT,
                BOOT.pack(
                    identity.uid,
                    identity.boot_id,
                    identity.reset_cause,
                    identity.node,
                    can,
                    (NO_CLOCK if identity.crystal_failed else 0) | (0 if local else REMOTE),
                    int(identity.capabilities),
                    crash is not None,
                    *(
                        (0, 0, 0, 0)
                        if crash is None
                        else (crash.pc, crash.lr, crash.cfsr, crash.uptime_us & 0xFFFF_FFFF)
                    ),
                ),
            )
        )
        """State that the chip reported after the last call."""

    # ---- interface of a program -------------------------------------------------------------

    def tick(self, now_us: int) -> tuple[float, float]:
        """Run the main loop once, at the start of a control period."""
        sensors = self._sensors
        left, right = sensors.encoders()
        counts = sensors.imu()
        samples = sensors.imu_samples()
        fresh, self._imu_samples = samples != self._imu_samples, samples
        payload = POLL.pack(now_us, *self._line(), left, right, fresh, *counts)
        view = self.view = self._take(self._chip.call(Operation.POLL, payload))
        return view.left / DUTY_ONE, view.right / DUTY_ONE

    def next_us(self, now_us: int) -> int:
        """Return the time of the next control period; the time may still change."""
        return max(now_us + 1, self.view.due_us)

    def receive(self, data: bytes, now_us: int) -> None:
        """Handle bytes that arrived at ``now_us``, µs of uptime."""
        for at in range(0, max(1, len(data)), _ROOM):
            payload = RECEIVE.pack(now_us, *self._line()) + data[at : at + _ROOM]
            fed = self.view.fed
            view = self._take(self._chip.call(Operation.RECEIVE, payload))
            self.view = view._replace(fed=fed)

    def data_to_send(self) -> bytes:
        """Return the bytes to send."""
        out, self._out = self._out, b""
        return out

    def _take(self, reply: bytes) -> View:
        view, wrote = view_of(reply)
        self._out += wrote
        if view.rebooted:
            self.reboot_wanted = RebootKind.NORMAL
        return view

    # ---- state ------------------------------------------------------------------------------

    @property
    def fed(self) -> bool:
        """True if the last tick fed the watchdog."""
        return bool(self.view.fed)

    @property
    def waits(self) -> bool:
        """Whether a command on CAN may wait for its tag, or frames may wait for the bus."""
        return self.view.keyed or self.view.blocked

    @property
    def drivers(self) -> bool:
        """Whether the motor drivers are enabled."""
        return self.view.drivers

    @property
    def state(self) -> DeviceState:
        """State in the mode table."""
        return STATES[self.view.state]

    @property
    def mode(self) -> Mode:
        """Present mode: the source of motion."""
        return MODE_OF[self.state]

    @property
    def stop_cause(self) -> StopCause:
        """Cause of the latched stop."""
        return StopCause(self.view.stop_cause)

    @property
    def latch(self) -> StopLatch:
        """The stop latch with its present cause."""
        return StopLatch(self.stop_cause)

    @property
    def session_id(self) -> int:
        """Session id of the host; 0: no session."""
        return self.view.session_id

    @property
    def negotiated(self) -> bool:
        """True if schema negotiation with the host is complete."""
        return self.view.negotiated

    @property
    def faults(self) -> Fault:
        """Fault bits as in the status message."""
        return Fault(self.view.faults)


class ChipFlash:
    """Flash memory of a chip; it keeps its content over resets."""

    def __init__(self, chip: Chip) -> None:
        """Use the flash of this chip."""
        self._chip = chip

    def power_lost(self) -> None:
        """End the program, and abort an operation of the flash at its present point."""
        self._chip.call(Operation.RESET, b"")

    def write(self, page: int, content: bytes) -> None:
        """Write these bytes at the start of a page, as if before this boot."""
        self._chip.call(Operation.FLASH, bytes((page,)) + content)

    def erase(self) -> None:
        """Erase everything, as in a new chip."""
        for page in range(PAGES):
            self.write(page, b"\xff" * PAGE_SIZE)


def answer(sensors: SensorSuite, what: int) -> bytes:
    """Return the readings that a chip requests, in the layout of ``chip.h``."""
    if what == Ask.CONTACTS:
        return bytes((contact_bits(sensors.bumpers(), cliff=sensors.cliff()),))
    if what == Ask.RANGES:
        front_m, left_m, right_m, age_us = sensors.ranges()
        return RANGES.pack(
            range_steps(front_m, 1e3), range_steps(left_m, 1e4), range_steps(right_m, 1e4), age_us
        )
    return POWER.pack(*map(milli, sensors.power()))
