"""Conditions on the device's reports: motors, battery, streams, sensors, reboots."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from protocol.messages.device import Encoders, Imu, PlannerState, Power, Range, Status
from protocol.messages.values import Fault, flag_labels

if TYPE_CHECKING:
    from bridge.supervise.inputs import RuleInputs, Scalar
    from bridge.supervise.measured import Measured
    from bridge.supervise.rules.conditions import Evidence
    from bridge.supervise.settings import BatteryRule, SilenceRule, StallRule

_STALL, _LOW = int(Fault.MOTOR_STALL), int(Fault.BATTERY_LOW)
_SENSORS = int(
    Fault.IMU
    | Fault.ENCODER_LEFT
    | Fault.ENCODER_RIGHT
    | Fault.ENCODER_LEFT_REVERSED
    | Fault.ENCODER_RIGHT_REVERSED
    | Fault.ENCODERS_SWAPPED
    | Fault.ULTRASONIC
    | Fault.INFRARED
    | Fault.BUMPER
)
STANDS_M = 0.004
"""Maximum distance of a wheel at standstill between two power samples, m. It is 2 cm/s over 0.2
s."""
BATTERY_SMOOTH_S = 1.0
"""Time constant of the voltage's smoothing, s. It is longer than the voltage drop at a motor's
start."""
STREAMS = (Encoders, Imu, Range, Status, Power, PlannerState)
"""Streams that the silence rule checks."""
FROZEN_S = 1.0
"""Minimum time of constant IMU registers that counts as frozen, s. With noise, only a few samples
are equal."""
TURNS_RAD_S = 0.2
"""Minimum yaw rate by the wheels for this check, rad/s. It is at least ten steps of the gyro."""


class Stall:
    """A wheel stands still while its motor draws current, or the device reports a stall."""

    grave = False

    def __init__(self, rule: StallRule) -> None:
        """Set the limits."""
        self._rule = rule
        self.restart()

    def restart(self) -> None:
        """Discard the wheels' distances."""
        self._power: Power | None = None
        self._distance_m = [0.0, 0.0]
        self._stands: list[tuple[str, float]] = []

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Check each wheel's distance since the last power sample, and its motor's current."""
        distance_m = self._distance_m
        distance_m[0] += abs(measured.left_m)
        distance_m[1] += abs(measured.right_m)
        power = inputs.power
        if power is not None and power is not self._power:
            whole = self._power is not None
            self._power = power
            self._stands = [
                (side, current_a)
                for side, moved_m, current_a in (
                    ("left", distance_m[0], power.motor_left_a),
                    ("right", distance_m[1], power.motor_right_a),
                )
                if whole and moved_m < STANDS_M and current_a >= self._rule.current_a
            ]
            distance_m[:] = (0.0, 0.0)
        status = inputs.status
        self._reported = status is not None and status.faults & _STALL != 0
        return self._reported or bool(self._stands)

    def evidence(self) -> Evidence:
        """Return the wheel and its motor's current."""
        if not self._stands:
            return "the device reports a stalled motor", {"by": "device"}
        sides = " and ".join(side for side, _ in self._stands)
        current_a = max(current for _, current in self._stands)
        text = f"the {sides} wheel stands still while its motor draws {current_a:.1f} A"
        return text, {"by": "host", "side": sides, "current_a": round(current_a, 2)}


class Battery:
    """The battery's smoothed voltage is low."""

    grave: bool
    _at_s: float
    """Time of the last voltage sample, s."""

    def __init__(self, rule: BatteryRule) -> None:
        """Set the limits."""
        self._rule = rule
        self.restart()

    def restart(self) -> None:
        """Discard the voltage."""
        self._power: Power | None = None
        self._battery_v: float | None = None
        self.grave = False

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Smooth the voltage and compare it with the limits."""
        del measured
        power = inputs.power
        if power is not None and power is not self._power:
            self._power = power
            volts = power.battery_v
            if self._battery_v is None:
                self._battery_v = volts
            else:
                share = min((inputs.time_s - self._at_s) / BATTERY_SMOOTH_S, 1.0)
                self._battery_v += share * (volts - self._battery_v)
            self._at_s = inputs.time_s
        volts = math.inf if self._battery_v is None else self._battery_v
        self.grave = volts < self._rule.empty_v
        status = inputs.status
        reported = status is not None and status.faults & _LOW != 0
        return volts < self._rule.low_v or reported

    def evidence(self) -> Evidence:
        """Return the voltage, or that the device reports it as low."""
        volts, rule = self._battery_v, self._rule
        if volts is None or volts >= rule.low_v:
            data: dict[str, Scalar] = {"by": "device"}
            if volts is not None:
                data["battery_v"] = round(volts, 2)
            return "the device reports a low battery", data
        how, limit_v = ("empty", rule.empty_v) if self.grave else ("low", rule.low_v)
        data = {"by": "host", "battery_v": round(volts, 2), "limit_v": limit_v}
        return f"the battery is {how}: {volts:.1f} V", data


class Silence:
    """The device is silent, or one of its streams has stopped."""

    grave = False

    def __init__(self, rule: SilenceRule) -> None:
        """Set the limits."""
        self._rule = rule

    def restart(self) -> None:
        """Do nothing: each step computes the ages."""

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Compare the ages of the link and of all streams with the limits."""
        del measured
        now_s, rule = inputs.time_s, self._rule
        self._stream, self._for_s = "", now_s - inputs.last_frame_s
        if self._for_s > rule.silent_s:
            return True
        oldest_s, arrived_s = now_s - rule.stream_s, inputs.arrived_s
        for kind in STREAMS:
            at_s = arrived_s.get(kind)
            if at_s is not None and at_s < oldest_s:
                self._stream, self._for_s = kind.__name__.lower(), now_s - at_s
                return True
        return False

    def evidence(self) -> Evidence:
        """Return the silent stream or device and the duration."""
        what = f"stream {self._stream}" if self._stream else "device"
        data: dict[str, Scalar] = {"stream": self._stream, "for_s": round(self._for_s, 2)}
        return f"no data from the {what} for {self._for_s:.1f} s", data


class Sensor:
    """The device reports a broken sensor, or the IMU is frozen while the wheels turn."""

    grave = False

    def __init__(self) -> None:
        """Start without a finding."""
        self.restart()

    def restart(self) -> None:
        """Discard the registers."""
        self._registers: tuple[int, ...] | None = None
        self._frozen_s = 0.0

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Check the fault bits and compare the IMU's registers."""
        status, imu = inputs.status, inputs.imu
        self._bits = 0 if status is None else status.faults & _SENSORS
        if imu is not None:
            registers = tuple(imu)
            turns = abs(measured.wheel_turn_rad) > TURNS_RAD_S * measured.step_s
            if registers != self._registers:
                self._registers, self._frozen_s = registers, 0.0
            elif turns:
                self._frozen_s += measured.step_s
        return self._bits != 0 or self._frozen_s >= FROZEN_S

    def evidence(self) -> Evidence:
        """Return the broken sensors."""
        if self._bits:
            names = ", ".join(flag_labels(Fault, self._bits))
            return f"the device reports a broken sensor: {names}", {"sensor": names}
        data: dict[str, Scalar] = {"sensor": "imu", "frozen_s": round(self._frozen_s, 2)}
        return "the IMU's values are constant while the robot turns", data


class Reset:
    """The device's boot id differs from its boot id at the start."""

    grave = False

    def __init__(self) -> None:
        """Start without a boot id."""
        self._first: int | None = None
        self._now: int | None = None

    def restart(self) -> None:
        """Keep the boot id of the start."""

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Compare the boot id with the boot id at the start."""
        del measured
        self._now = inputs.boot_id
        if self._first is None:
            self._first = self._now
        return self._now != self._first

    def evidence(self) -> Evidence:
        """Return both boot ids."""
        return "the device rebooted", {"boot_id": str(self._now), "was": str(self._first)}
