"""The C firmware on a virtual board, from one boot of the virtual sweeper's chip to its reset."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, NamedTuple

from protocol.messages.values import Fault, Mode, RebootKind, StopCause
from sim_device.core.chip import PAYLOAD_MAX, Ask, Operation
from sim_device.device.identity import CAPABILITIES
from sim_device.device.modes import MODE_OF, DeviceState
from sim_device.device.safety import StopLatch
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
NO_LIMIT = 0xFFFF_FFFF
"""Free space of a line without a limit (``CHIP_NO_LIMIT``)."""
DUTY_ONE = 10_000
_PAGES, _PAGE_SIZE = 2, 1024
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
"""State of each mode number in ``core/modes.h``."""


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
    """True if the program obeys signed commands only."""
    flash_busy: int
    blocked: bool
    """True if frames wait for the bus."""
    faults: int
    session_id: int
    waited_us: int
    """Time for which the program blocked its main loop, µs."""
    due_us: int
    """Uptime of the program's next control period, µs."""


def view_of(reply: bytes) -> tuple[View, bytes]:
    """Return the chip's state from a reply, and the bytes that the chip has sent."""
    return View._make(_REPLY.unpack_from(reply)), reply[_REPLY.size :]


class LineState(NamedTuple):
    """State of the chip's end of the line."""

    room: int = NO_LIMIT
    """Free space of the line: bytes, or frames on a bus."""
    send_errors: int = 0
    receive_errors: int = 0
    off: bool = False
    """True if the controller has left the bus."""
    offs: int = 0
    """Number of times that it has left the bus since the boot."""


class CoreFirmware:
    """One run of the program on a chip, from a boot to the next reset."""

    def __init__(  # noqa: PLR0913 - inputs of a boot
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
            can: whether the host is on a CAN bus instead of a UART.
            local: whether only a person beside the robot can use the UART.
            line: returns the present state of the line.

        """
        self._chip, self._sensors, self._line = chip, sensors, line
        self._imu_samples = 0
        self._out = b""
        self.identity = identity
        self.reboot_wanted: RebootKind | None = None
        """Reset requested by the program; None: no request. A factory reset has already been
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
                    int(CAPABILITIES),
                    crash is not None,
                    *(
                        (0, 0, 0, 0)
                        if crash is None
                        else (crash.pc, crash.lr, crash.cfsr, crash.uptime_us & 0xFFFF_FFFF)
                    ),
                ),
            )
        )
        """State reported after the last call."""

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
        """Return the time of the next control period, which may change before it is reached."""
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
        """Whether a command on CAN may wait for its tag, or frames for room on the bus."""
        return self.view.keyed or self.view.blocked

    @property
    def drivers(self) -> bool:
        """Whether the motor drivers are enabled."""
        return self.view.drivers

    @property
    def state(self) -> DeviceState:
        """Where it stands in the mode table."""
        return STATES[self.view.state]

    @property
    def mode(self) -> Mode:
        """What moves the wheels."""
        return MODE_OF[self.state]

    @property
    def stop_cause(self) -> StopCause:
        """Cause of the latched stop."""
        return StopCause(self.view.stop_cause)

    @property
    def latch(self) -> StopLatch:
        """The latched stop, as it is now."""
        return StopLatch(self.stop_cause)

    @property
    def session_id(self) -> int:
        """The host's session; 0: none."""
        return self.view.session_id

    @property
    def negotiated(self) -> bool:
        """Whether the host has agreed on the messages."""
        return self.view.negotiated

    @property
    def faults(self) -> Fault:
        """As the status message says them."""
        return Fault(self.view.faults)


class ChipFlash:
    """The flash of a chip, beyond its resets."""

    def __init__(self, chip: Chip) -> None:
        """Of this chip."""
        self._chip = chip

    def power_lost(self) -> None:
        """End the program, and what the flash was doing where it is."""
        self._chip.call(Operation.RESET, b"")

    def write(self, page: int, content: bytes) -> None:
        """Let a page begin with these bytes, as if they had been written in a life before."""
        self._chip.call(Operation.FLASH, bytes((page,)) + content)

    def erase(self) -> None:
        """As it leaves the factory."""
        for page in range(_PAGES):
            self.write(page, b"\xff" * _PAGE_SIZE)


def answer(sensors: SensorSuite, what: int) -> bytes:
    """Return the readings that a chip asks for, in the layout of ``chip.h``."""
    if what == Ask.CONTACTS:
        return bytes((contact_bits(sensors.bumpers(), cliff=sensors.cliff()),))
    if what == Ask.RANGES:
        front_m, left_m, right_m, age_us = sensors.ranges()
        return RANGES.pack(
            range_steps(front_m, 1e3), range_steps(left_m, 1e4), range_steps(right_m, 1e4), age_us
        )
    return POWER.pack(*map(milli, sensors.power()))
