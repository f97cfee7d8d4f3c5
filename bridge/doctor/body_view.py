"""What a device's messages tell of its body: the supervisor's rules and a look at the sensors.

The messages are walked through in the device's own time, as a supervisor would have seen them,
so that what the line did to them does not count.
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
from protocol.messages import Encoders, Imu, PlannerState, Power, Range, Status

if TYPE_CHECKING:
    from protocol.schema.message import Message

_LOOKED_AT = frozenset({Imu, Encoders, Range, Power, Status, PlannerState})
STEP_US = 20_000
GAP_US = 500_000
"""Between two messages: longer, and what was between them is not known."""
REST_S = 1.0
"""The wheels' counts must not have changed for so long, and half as long again is averaged."""
SHIFT_DEG_S = 1.0
"""Of the gyro from rest to rest: a hundred times what warming up brings."""
GRAVITY_OFF = 0.15
LEAN_DEG = 6.0
FROZEN = 60
"""Equal samples of the inertial sensor, 0.6 s; a chip with noise gives a few at most."""
LIVELY = 3
_G_LSB = 16384.0
_DEG_S_LSB = 131.0
_MOST = 200
_QUIET = {"silence": "off", "progress": "off", "fence": "off", "reset": "off"}
"""Rules that are about the line, or that need to know what the robot was to do."""


@dataclass(frozen=True, slots=True)
class Sign:
    """Something found about the body or its sensors."""

    kind: str
    at_s: float
    """Device time since the first message."""
    text: str
    data: dict[str, float | str | bool]


class BodyView:
    """Looks at one device; :meth:`take` every message of it."""

    def __init__(self, model: RobotModel | None = None) -> None:
        """Nothing is known."""
        self.signs: list[Sign] = []
        self.onboard = ""
        """The device's planner that was started, where its start was seen."""
        self._model = model or RobotModel()
        rules = {name: {"reaction": level} for name, level in _QUIET.items()}
        self._settings = settings_from(rules)
        self._last_us: DeviceUs | None = None
        self._first_us = 0
        self._rest = _Rest()
        self._frozen = _Frozen()
        self._begin()

    def _begin(self) -> None:
        """A boot, or the first message after a gap."""
        self._estimator = PoseEstimator(self._model, Pose2(0.0, 0.0, 0.0))
        self._supervisor = Supervisor(self._model, self._settings)
        self._step_us: int | None = None
        self._newest: dict[type[Message], Any] = {}

    def take(self, message: Message, stamp_us: int, _arrived_ns: int) -> None:
        """Take a message of the device."""
        if None in tuple(message) or message.__class__ not in _LOOKED_AT:
            return  # of no interest, or an older device left fields out
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
        if self._step_us is None or now_us >= self._step_us + STEP_US:
            self._step_us = now_us
            self._supervise(now_us)

    def _unwrapped(self, stamp_us: int) -> int:
        """The stamp without its wraps; a gap begins everything anew."""
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
        if found is not None and len(self.signs) < _MOST:
            kind, text, data = found
            at_s = round((now_us - self._first_us) * 1e-6, 2)
            self.signs.append(Sign(kind, at_s, text, data))


_Found = tuple[str, str, dict[str, float | str | bool]]


class _Rest:
    """The inertial sensor while the wheels stand: its rates and gravity, from rest to rest."""

    def __init__(self) -> None:
        self._counts: Encoders | None = None
        self._known: tuple[float, float, float, float] | None = None
        """Yaw rate (°/s) and gravity (g) of an earlier rest."""
        self._reported = False
        self.forget()

    def forget(self) -> None:
        """No rest is under way."""
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
            imu.gyro_z / _DEG_S_LSB,
            imu.accel_x / _G_LSB,
            imu.accel_y / _G_LSB,
            imu.accel_z / _G_LSB,
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
            text = f"at rest the accelerometer reads {gravity:.2f} g"
            found = "imu", text, {"gravity_g": round(gravity, 3)}
        elif known is not None and abs(rate - known[0]) > SHIFT_DEG_S:
            by = rate - known[0]
            text = f"the gyro's rate at rest changed by {by:+.1f} °/s"
            found = "imu", text, {"shift_deg_s": round(by, 2)}
        elif known is not None:
            lean_deg = math.degrees(math.hypot(x - known[1], y - known[2]))
            if lean_deg > LEAN_DEG:
                text = f"at rest it leans otherwise than before, by {lean_deg:.0f}°"
                found = "imu", text, {"lean_deg": round(lean_deg, 1)}
        return found


class _Frozen:
    """Runs of equal samples."""

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
        # A virtual chip without noise repeats itself at rest: it says nothing.
        lively = self._changes > FROZEN and self._repeats < 0.5 * self._changes
        if self._run != FROZEN or not lively:
            return None
        text = f"the inertial sensor gave the same {FROZEN} times in a row"
        return "imu", text, {"equal": FROZEN}
