"""Examines a robot by its messages, with the rules of supervision and checks of the IMU.

The messages are processed in device time, so delays on the link do not affect the result.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bridge.motion.estimation.estimator import PoseEstimator
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.supervise import Level, RuleInputs, Supervisor, settings_from
from protocol.clock import DeviceUs, extend_us
from protocol.imu import NOMINAL, NOMINAL_DEG_S_LSB, NOMINAL_G_LSB, ImuReader
from protocol.messages.device import Encoders, Imu, PlannerState, Power, Range, Status

if TYPE_CHECKING:
    from protocol.schema.message import Message

_LOOKED_AT = frozenset({Imu, Encoders, Range, Power, Status, PlannerState})
STEP_US = 20_000
"""Period of the supervision rules, µs: the control period of the host."""
GAP_US = 500_000
"""Maximum pause between two messages, µs; after a longer one the estimate restarts."""
REST_S = 1.0
"""Time without encoder counts after which the robot counts as standing still, s."""
SHIFT_DEG_S = 1.0
"""Minimum change of the gyro rate between two standstills that is reported, °/s. It is about a
hundred times the effect of warming up."""
GRAVITY_OFF = 0.15
"""Minimum deviation of the measured gravity from 1 g that is reported, g."""
LEAN_DEG = 6.0
"""Minimum change of the tilt between two standstills that is reported, degrees."""
FROZEN = 60
"""Minimum number of equal consecutive IMU samples that is reported. It is 0.6 s of samples. With
sensor noise, only a few are equal.
"""
FROZEN_POWER = 25
"""Minimum number of equal consecutive power samples that is reported while the robot drives. It is
5 s of samples. The battery's voltage alone changes more often."""
LIVELY = 3
"""Maximum number of consecutive equal samples that counts as normal sensor noise."""
_MAX_SIGNS = 200
"""Maximum number of signs that are stored for one examination."""
_QUIET = {"silence": "off", "progress": "off", "fence": "off", "reset": "off"}
"""Rules that are off, because they evaluate the link or need data about the robot's task."""


@dataclass(frozen=True, slots=True)
class Sign:
    """A fault of the robot or its sensors, at one time."""

    kind: str
    at_s: float
    """Device time since the first message."""
    text: str
    data: dict[str, float | str | bool]


class BodyView:
    """Examines the messages of one device, passed in by :meth:`take`."""

    def __init__(self) -> None:
        """Start without any message."""
        self.signs: list[Sign] = []
        self.onboard = ""
        """Name of the onboard planner whose start was recorded; empty: no start was recorded."""
        self._model = RobotModel()
        rules = {name: {"reaction": level} for name, level in _QUIET.items()}
        self._settings = settings_from(rules)
        self._last_us: DeviceUs | None = None
        self._first_us = 0
        self._imu = ImuReader(NOMINAL)
        self._rest = _Rest()
        self._frozen = _Frozen()
        self._frozen_power = _FrozenPower()
        self._begin()

    def _begin(self) -> None:
        """Start a new estimate: at a boot, or after a gap."""
        self._estimator = PoseEstimator(self._model, Pose2(0.0, 0.0, 0.0))
        self._supervisor = Supervisor(self._model, self._settings)
        self._step_us: int | None = None
        self._newest: dict[type[Message], Any] = {}

    def take(self, message: Message, stamp_us: int, _arrived_ns: int) -> None:
        """Handle a message of the device."""
        known = self._imu.take(message)
        if known is None:
            return
        message = known
        if None in tuple(message) or message.__class__ not in _LOOKED_AT:
            return  # not examined, or an older device does not send all fields
        now_us = self._unwrapped(stamp_us)
        now_s = now_us * 1e-6
        self._newest[message.__class__] = message
        if isinstance(message, Imu):
            self._estimator.on_imu(
                now_s,
                message.gyro_z_rad_s,
                *(message.accel_x_m_s2, message.accel_y_m_s2, message.temperature_deg_c),
            )
            self._sign(self._rest.on_imu(now_s, message), now_us)
            self._sign(self._frozen.on_imu(message), now_us)
        elif isinstance(message, Encoders):
            self._estimator.on_encoders(now_s, message.left, message.right)
            self._rest.on_encoders(now_s, message)
            self._frozen_power.on_encoders(message)
        elif isinstance(message, Power):
            self._sign(self._frozen_power.on_power(message), now_us)
        if self._step_us is None or now_us >= self._step_us + STEP_US:
            self._step_us = now_us
            self._supervise(now_us)

    def _unwrapped(self, stamp_us: int) -> int:
        """Return the stamp without wraps. A gap starts a new estimate."""
        last_us = self._last_us
        if last_us is None:
            self._first_us = self._last_us = DeviceUs(stamp_us)
            return stamp_us
        now_us = extend_us(last_us, stamp_us)
        if abs(now_us - last_us) > GAP_US:
            self._begin()
            self._rest.forget()
        self._last_us = now_us
        return now_us

    def _supervise(self, now_us: int) -> None:
        estimator, newest, now_s = self._estimator, self._newest, now_us * 1e-6
        reactions = self._supervisor.step(
            RuleInputs(
                now_s,
                estimator.pose,
                estimator.v_m_s,
                estimator.yaw_rate_rad_s,
                estimator.wheel_scale,
                now_s,
                imu=newest.get(Imu),
                encoders=newest.get(Encoders),
                range=newest.get(Range),
                power=newest.get(Power),
                status=newest.get(Status),
                planner=newest.get(PlannerState),
                onboard=self.onboard,
            )
        )
        for reaction in reactions:
            if reaction.level is not Level.OFF and reaction.kind != "pause":
                self._sign((reaction.kind, reaction.text, reaction.data), now_us)

    def _sign(
        self, found: tuple[str, str, dict[str, float | str | bool]] | None, now_us: int
    ) -> None:
        if found is not None and len(self.signs) < _MAX_SIGNS:
            kind, text, data = found
            at_s = round((now_us - self._first_us) * 1e-6, 2)
            self.signs.append(Sign(kind, at_s, text, data))


_Found = tuple[str, str, dict[str, float | str | bool]]


class _Rest:
    """Compares the IMU's yaw rate and gravity between standstills."""

    def __init__(self) -> None:
        self._counts: Encoders | None = None
        self._known: tuple[float, float, float, float] | None = None
        """Yaw rate (°/s) and gravity vector (g) of the last normal standstill."""
        self._reported = False
        self.forget()

    def forget(self) -> None:
        """Discard the current standstill."""
        self._since_s = math.inf
        self._sums = [0.0] * 4
        self._count = 0
        self._counts = None

    def on_encoders(self, now_s: float, counts: Encoders) -> None:
        if self._counts is None or tuple(counts) != tuple(self._counts):
            self._counts, self._since_s = counts, now_s
            self._sums, self._count = [0.0] * 4, 0

    def on_imu(self, now_s: float, imu: Imu) -> _Found | None:
        if now_s - self._since_s < REST_S:
            return None
        values = (
            imu.gyro_z / NOMINAL_DEG_S_LSB,
            imu.accel_x / NOMINAL_G_LSB,
            imu.accel_y / NOMINAL_G_LSB,
            imu.accel_z / NOMINAL_G_LSB,
        )
        for axis, value in enumerate(values):
            self._sums[axis] += value
        self._count += 1
        if self._count < FROZEN // 2:
            return None
        rate, x, y, z = (total / self._count for total in self._sums)
        self._sums, self._count = [0.0] * 4, 0
        found = self._judge(rate, x, y, z)
        if found is None:
            self._known, self._reported = (rate, x, y, z), False
            return None
        before, self._reported = self._reported, True
        return None if before else found

    def _judge(self, rate: float, x: float, y: float, z: float) -> _Found | None:
        known = self._known
        gravity = math.sqrt(x * x + y * y + z * z)
        found: _Found | None = None
        if abs(gravity - 1.0) > GRAVITY_OFF:
            text = f"at standstill the accelerometer reads {gravity:.2f} g"
            found = "imu", text, {"gravity_g": round(gravity, 3)}
        elif known is not None and abs(rate - known[0]) > SHIFT_DEG_S:
            by = rate - known[0]
            text = f"the gyro rate at standstill changed by {by:+.1f} °/s"
            found = "imu", text, {"shift_deg_s": round(by, 2)}
        elif known is not None:
            lean_deg = math.degrees(math.hypot(x - known[1], y - known[2]))
            if lean_deg > LEAN_DEG:
                text = f"the tilt at standstill changed by {lean_deg:.0f}°"
                found = "imu", text, {"lean_deg": round(lean_deg, 1)}
        return found


class _Frozen:
    """Detects an IMU that repeats the same sample."""

    def __init__(self) -> None:
        self._before: tuple[int, ...] | None = None
        self._run = 0
        self._changes = 0
        self._repeats = 0

    def on_imu(self, imu: Imu) -> _Found | None:
        registers = tuple(imu)
        if registers != self._before:
            self._before, self._run = registers, 0
            self._changes += 1
            return None
        self._run += 1
        if self._run <= LIVELY:
            self._repeats += 1
        # A virtual IMU without noise repeats samples at standstill, which is not a fault.
        lively = self._changes > FROZEN and self._repeats < 0.5 * self._changes
        if self._run != FROZEN or not lively:
            return None
        text = f"the inertial sensor repeated the same sample {FROZEN} times"
        return "imu", text, {"equal": FROZEN}


class _FrozenPower:
    """Detects a converter that repeats its readings of supply and motor currents."""

    def __init__(self) -> None:
        self._counts: Encoders | None = None
        self._moved = False
        """True if a wheel has turned since the last power sample."""
        self._before: Power | None = None
        self._run = 0

    def on_encoders(self, counts: Encoders) -> None:
        self._moved |= self._counts is not None and tuple(counts) != tuple(self._counts)
        self._counts = counts

    def on_power(self, power: Power) -> _Found | None:
        if self._before is None or tuple(power) != tuple(self._before):
            self._before, self._run = power, 0
        elif self._moved:
            self._run += 1
        found = self._moved and self._run == FROZEN_POWER
        self._moved = False
        if not found:
            return None
        text = f"{FROZEN_POWER} readings of supply and motor currents were equal while it drove"
        return "adc", text, {"equal": FROZEN_POWER}
