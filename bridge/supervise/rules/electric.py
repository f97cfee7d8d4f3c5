"""Conditions on what the device tells of itself: motors, battery, streams, sensors, boots."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from protocol.messages import Encoders, Imu, PlannerState, Power, Range, Status
from protocol.values import Fault, flag_labels

if TYPE_CHECKING:
    from bridge.supervise.inputs import RuleInputs, Scalar
    from bridge.supervise.measured import Measured
    from bridge.supervise.rules.conditions import Evidence
    from bridge.supervise.settings import BatteryRule, SilenceRule, StallRule

_STALL, _LOW = int(Fault.MOTOR_STALL), int(Fault.BATTERY_LOW)
_SENSORS = int(
    Fault.IMU | Fault.ENCODER_LEFT | Fault.ENCODER_RIGHT | Fault.ULTRASONIC | Fault.INFRARED
)
STANDS_M = 0.004
"""Way of a wheel between two power readings, 0.2 s: at 2 cm/s it stands."""
BATTERY_SMOOTH_S = 1.0
"""Over the dip of a motor that starts."""
STREAMS = (Encoders, Imu, Range, Status, Power, PlannerState)
FROZEN_S = 1.0
"""A chip with noise repeats itself for a few samples at most."""
TURNS_RAD_S = 0.2
"""By the wheels: ten steps of the gyro's register, and more, would show."""


class Stall:
    """A wheel stands and its motor draws current, or the device's own check says so."""

    grave = False

    def __init__(self, rule: StallRule) -> None:
        """Keep the limits."""
        self._rule = rule
        self.restart()

    def restart(self) -> None:
        """Nothing is known of the wheels."""
        self._power: Power | None = None
        self._way_m = [0.0, 0.0]
        self._stands: list[tuple[str, float]] = []

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """See each wheel's way since the last power reading, and its motor's current."""
        way = self._way_m
        way[0] += abs(measured.left_m)
        way[1] += abs(measured.right_m)
        power = inputs.power
        if power is not None and power is not self._power:
            whole = self._power is not None
            self._power = power
            self._stands = [
                (side, current_a)
                for side, moved_m, current_a in (
                    ("left", way[0], power.motor_left_a),
                    ("right", way[1], power.motor_right_a),
                )
                if whole and moved_m < STANDS_M and current_a >= self._rule.current_a
            ]
            way[:] = (0.0, 0.0)
        status = inputs.status
        self._reported = status is not None and status.faults & _STALL != 0
        return self._reported or bool(self._stands)

    def evidence(self) -> Evidence:
        """Which wheel, and what its motor draws."""
        if not self._stands:
            return "the device says that a motor stalls", {"by": "device"}
        sides = " and ".join(side for side, _ in self._stands)
        current_a = max(current for _, current in self._stands)
        text = f"the {sides} wheel stands while its motor draws {current_a:.1f} A"
        return text, {"by": "host", "side": sides, "current_a": round(current_a, 2)}


class Battery:
    """The battery's voltage, smoothed over a motor's start."""

    grave: bool
    _at_s: float
    """When the voltage was last told."""

    def __init__(self, rule: BatteryRule) -> None:
        """Keep the limits."""
        self._rule = rule
        self.restart()

    def restart(self) -> None:
        """Nothing is known of it."""
        self._power: Power | None = None
        self._battery_v: float | None = None
        self.grave = False

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Smooth the voltage and compare."""
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
        """How low, or that the device says so."""
        volts, rule = self._battery_v, self._rule
        if volts is None or volts >= rule.low_v:
            data: dict[str, Scalar] = {"by": "device"}
            if volts is not None:
                data["battery_v"] = round(volts, 2)
            return "the device says that the battery is low", data
        how, limit_v = ("empty", rule.empty_v) if self.grave else ("low", rule.low_v)
        data = {"by": "host", "battery_v": round(volts, 2), "limit_v": limit_v}
        return f"the battery is {how}: {volts:.1f} V", data


class Silence:
    """Nothing of the device, or of one of the streams that it had."""

    grave = False

    def __init__(self, rule: SilenceRule) -> None:
        """Keep the limits."""
        self._rule = rule

    def restart(self) -> None:
        """Ages are told anew with each step."""

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Compare the ages of all there is."""
        del measured
        now_s, rule = inputs.time_s, self._rule
        self._stream, self._for_s = "", now_s - inputs.heard_s
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
        """What is silent, and since when."""
        what = f"stream {self._stream}" if self._stream else "device"
        data: dict[str, Scalar] = {"stream": self._stream, "for_s": round(self._for_s, 2)}
        return f"nothing of the {what} for {self._for_s:.1f} s", data


class Sensor:
    """The device's own fault bits; and a gyro that says the same while the wheels turn."""

    grave = False

    def __init__(self) -> None:
        """Whole."""
        self.restart()

    def restart(self) -> None:
        """Whole."""
        self._registers: tuple[int, ...] | None = None
        self._frozen_s = 0.0

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """See the bits; compare the sensor's registers."""
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
        """Which."""
        if self._bits:
            names = ", ".join(flag_labels(Fault, self._bits))
            return f"the device says that a sensor is broken: {names}", {"sensor": names}
        data: dict[str, Scalar] = {"sensor": "imu", "frozen_s": round(self._frozen_s, 2)}
        return "the inertial sensor's registers do not change while it turns", data


class Reset:
    """Another boot than the one in which the watch began."""

    grave = False

    def __init__(self) -> None:
        """No boot is known."""
        self._first: int | None = None
        self._now: int | None = None

    def restart(self) -> None:
        """The boot that was known is still the one to be watched."""

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Compare the boot id."""
        del measured
        self._now = inputs.boot_id
        if self._first is None:
            self._first = self._now
        return self._now != self._first

    def evidence(self) -> Evidence:
        """Which boots."""
        return "the device has booted anew", {"boot_id": str(self._now), "was": str(self._first)}
