"""Evaluation of the bring-up's measurements: connections and polarities. No I/O.

The signs are the same as in PROTOCOL.md. Counts increase forwards; x points forwards, y left, z up;
the yaw rate is positive counter-clockwise; the acceleration at standstill is +1 g upwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean, pstdev
from typing import TYPE_CHECKING, NamedTuple

from bridge.bringup.gyro import REST_RAD_S
from bridge.motion.estimation.odometry import encoder_delta
from protocol.imu import GRAVITY_M_S2
from protocol.messages.device import Encoders

if TYPE_CHECKING:
    from collections.abc import Sequence

    from protocol.schema.message import Message

GRAVITY_OFF_M_S2 = 1.0
"""Maximum normal error of gravity, m/s². It is 0.1 g, for the sensor's offset and a tilted
stand."""
MIN_COUNTS = 30
"""Minimum count that shows a turning wheel. A kick gives hundreds of counts; vibration gives a
few."""
BATTERY_SHARE = 0.3
"""Maximum normal deviation of the battery voltage, relative to the nominal voltage."""
LOGIC_V = (4.6, 5.4)
"""Normal range of the logic supply, V."""
IDLE_A = 0.2
"""Maximum normal motor current at zero duty, A."""
FREE_A = 1.0
"""Maximum normal current of a motor whose wheel turns freely, A. It is half of an L298N's maximum
continuous current (data sheet L298, absolute maximum ratings, DC operation: 2 A per channel)."""
_AXES = ("x", "y", "z")
LEFT, RIGHT = "left", "right"


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Result of one check."""

    step: str
    ok: bool | None
    """True: passed; False: failed; None: the check was skipped."""
    text: str
    advice: str = ""
    """The remedy."""
    swapped: str = ""
    """Swapped plugs, ``motor`` or ``encoder``; empty: no plugs are swapped."""

    @property
    def line(self) -> str:
        """The result in one line."""
        sign = {True: "ok", False: "WRONG", None: "skipped"}[self.ok]
        tail = f"; {self.advice}" if self.advice else ""
        return f"{self.step}: {sign}: {self.text}{tail}"


def good(step: str, text: str) -> CheckResult:
    """Return a passed check."""
    return CheckResult(step, ok=True, text=text)


def wrong(step: str, text: str, advice: str) -> CheckResult:
    """Return a failed check."""
    return CheckResult(step, ok=False, text=text, advice=advice)


def left_out(step: str, text: str, advice: str = "") -> CheckResult:
    """Return a skipped check."""
    return CheckResult(step, ok=None, text=text, advice=advice)


class Kick(NamedTuple):
    """One motor output that was driven forwards for a short time."""

    output: str
    """The driven output: ``left`` or ``right``."""
    turned: str
    """The wheel that turned, by the person's observation: ``left``, ``right`` or ``none``."""
    forwards: bool
    left_counts: int
    right_counts: int


def judge_kicks(kicks: Sequence[Kick]) -> list[CheckResult]:
    """Find swapped and reversed motor outputs and encoders.

    The person answers which wheel turned, and in which direction. If outputs and encoders are both
    swapped, the program alone cannot detect it, and the robot would turn in the wrong direction.
    """
    found: list[CheckResult] = []
    for kick in kicks:
        found += _judge_motor(kick)
        if kick.turned != "none":
            found += judge_encoder(kick)
    swapped = [f.swapped for f in found if f.swapped]
    if len(swapped) > 1:  # both sides have the same finding, so report it once
        found = [f for f in found if not f.swapped]
        found += [_swapped(what, f"{what}s") for what in sorted(set(swapped))]
    return found


_SWAP_ADVICE = {
    "motor": "cross the two motor plugs (or OUT1/2 with OUT3/4 at the bridge)",
    "encoder": "cross the two encoder plugs",
}


def _swapped(what: str, step: str) -> CheckResult:
    text = "left and right are swapped"
    return CheckResult(step, ok=False, text=text, advice=_SWAP_ADVICE[what], swapped=what)


def _judge_motor(kick: Kick) -> list[CheckResult]:
    step = f"motor {kick.output}"
    if kick.turned == "none":
        return [
            wrong(
                step,
                "neither wheel turned",
                "check the enable input and the supply of the motor driver, and the motor's plug",
            )
        ]
    found = []
    if kick.turned != kick.output:
        found.append(_swapped("motor", step))
    if not kick.forwards:
        advice = f"reverse the plug of the {kick.turned} wheel's motor"
        found.append(wrong(step, "turns backwards", advice))
    return found or [good(step, f"turns the {kick.turned} wheel forwards")]


def judge_encoder(kick: Kick) -> list[CheckResult]:
    """Check the encoder of the wheel that turned: side, sign, and whether it counts."""
    wheel = kick.turned
    step = f"encoder {wheel}"
    counts = {LEFT: kick.left_counts, RIGHT: kick.right_counts}
    own, others = counts[wheel], counts[_other(wheel)]
    found = []
    if abs(own) < MIN_COUNTS and abs(others) < MIN_COUNTS:
        advice = "check the plug and the supply of the encoder"
        return [wrong(step, f"does not count ({own})", advice)]
    if abs(others) > 2 * abs(own):
        found.append(_swapped("encoder", step))
        own = others
    if (own > 0) is not kick.forwards:
        text = f"counts in reverse ({own:+d})"
        advice = f"swap channels A and B of the {wheel} wheel's encoder"
        found.append(wrong(step, text, advice))
    return found or [good(step, f"counts {own:+d}")]


# ---- first power ------------------------------------------------------------------------


class Counts(NamedTuple):
    """Encoder counts of both wheels during one measurement."""

    left: int
    right: int


def turned(before: Encoders, kept: Sequence[tuple[float, Message]]) -> Counts:
    """Return the counts from ``before`` to the last encoder reading in ``kept``.

    Args:
        before: encoder reading before ``kept``.
        kept: messages with their device times, s; messages of other types are ignored.

    """
    left = right = 0
    last = before
    for _, reading in kept:
        if isinstance(reading, Encoders):
            left += encoder_delta(last.left, reading.left)
            right += encoder_delta(last.right, reading.right)
            last = reading
    return Counts(left, right)


def last_change_s(kept: Sequence[tuple[float, Message]]) -> float:
    """Return the time from the first encoder reading to the last change of a count, s.

    It is 0 if the counts are constant.
    """
    readings = [(t_s, (m.left, m.right)) for t_s, m in kept if isinstance(m, Encoders)]
    changes = [now[0] for before, now in pairwise(readings) if before[1] != now[1]]
    return changes[-1] - readings[0][0] if changes else 0.0


def judge_stage(
    step: str, output: str, both: tuple[Counts, Counts], current_a: float, *, must_turn: bool
) -> CheckResult:
    """Evaluate one output at one duty, driven forwards and then backwards.

    Args:
        step: name of the check.
        output: the driven output: ``left`` or ``right``.
        both: counts while it was driven forwards, and while it was driven backwards.
        current_a: largest current of a motor, A.
        must_turn: True if the duty is high enough to turn any wheel. A low duty may not overcome
            the friction of the gear.

    """
    if current_a > FREE_A:
        advice = "SWITCH THE SUPPLY OFF; look for a short circuit or a blocked wheel"
        return wrong(step, f"a motor takes {current_a:.2f} A", advice)
    own, others = ([getattr(counts, side) for counts in both] for side in (output, _other(output)))
    if max(map(abs, others)) >= MIN_COUNTS and max(map(abs, others)) > 2 * max(map(abs, own)):
        return _swapped("motor", step)
    figures = f"{own[0]:+d} and {own[1]:+d} counts, at most {current_a:.2f} A"
    if max(map(abs, own)) >= MIN_COUNTS:
        return _judge_directions(step, output, own, figures)
    if not must_turn:
        return good(step, f"does not turn yet, at most {current_a:.2f} A")
    advice = "check the motor driver's enable input and supply, the motor's plug, and the gear"
    return wrong(step, f"does not turn ({figures})", advice)


def _judge_directions(step: str, output: str, own: Sequence[int], figures: str) -> CheckResult:
    forwards, backwards = own
    if backwards < 0 < forwards:
        return good(step, f"turns forwards and backwards ({figures})")
    if forwards < 0 < backwards:
        advice = f"reverse the plug of the {output} wheel's motor"
        return wrong(step, f"turns backwards ({figures})", advice)
    advice = "check both direction inputs of the motor driver"
    return wrong(step, f"turns in one direction only ({figures})", advice)


def _other(side: str) -> str:
    return RIGHT if side == LEFT else LEFT


# ---- at rest ----------------------------------------------------------------------------


class ImuSample(NamedTuple):
    """Acceleration (m/s²) and angular rate (rad/s) of one sample."""

    accel: tuple[float, float, float]
    gyro: tuple[float, float, float]


def judge_rest(samples: Sequence[ImuSample]) -> list[CheckResult]:
    """Check the IMU of a robot that stands still on level floor."""
    if not samples:
        advice = "check the supply and the bus of the IMU"
        return [wrong("imu", "no samples", advice)]
    accel = [fmean(s.accel[i] for s in samples) for i in range(3)]
    gyro = [fmean(s.gyro[i] for s in samples) for i in range(3)]
    found = []
    size = math.sqrt(sum(a * a for a in accel))
    shown = ", ".join(f"{a:+.2f}" for a in accel)
    if abs(size - GRAVITY_M_S2) > GRAVITY_OFF_M_S2:
        text = f"reads {size:.2f} m/s² at standstill, not 9.81 ({shown})"
        advice = "check that the firmware reports the scale of the accelerometer correctly"
        found.append(wrong("imu gravity", text, advice))
    else:
        found.append(_judge_up(accel, shown))
    fastest = max(range(3), key=lambda i: abs(gyro[i]))
    rate = math.degrees(gyro[fastest])
    if abs(gyro[fastest]) > REST_RAD_S:
        text = f"{_AXES[fastest]} reads {rate:+.1f} °/s at standstill"
        advice = "check that the robot does not move, and the scale of the gyro; else replace it"
        found.append(wrong("imu rates", text, advice))
    else:
        text = f"at most {rate:+.2f} °/s at standstill ({_AXES[fastest]})"
        found.append(good("imu rates", text))
    if len(samples) > 1 and all(
        pstdev(s.accel[i] for s in samples) == 0.0 and pstdev(s.gyro[i] for s in samples) == 0.0
        for i in range(3)
    ):
        text = "the samples are all equal"
        advice = "a real sensor has noise; check its bus"
        found.append(left_out("imu noise", text, advice))
    return found


def _judge_up(accel: Sequence[float], shown: str) -> CheckResult:
    axis = max(range(3), key=lambda i: abs(accel[i]))
    sign = "+" if accel[axis] > 0.0 else "-"
    name = f"{sign}{_AXES[axis]}"
    if name == "+z":
        return good("imu gravity", f"z is up ({shown} m/s²)")
    advice = "the IMU is upside down" if name == "-z" else "the IMU is mounted on its edge"
    text = f"{name} of the IMU points up, not +z ({shown} m/s²)"
    return wrong(
        "imu gravity", text, f"{advice}; mount it, or map its axes, as PROTOCOL.md specifies"
    )


# ---- by hand ----------------------------------------------------------------------------


class Axis(NamedTuple):
    """One axis of a sensor."""

    name: str
    value: float

    @property
    def signed(self) -> str:
        """The axis with its sign: ``+x`` to ``-z``."""
        return f"{'+' if self.value > 0.0 else '-'}{self.name}"


def strongest(values: Sequence[float]) -> Axis:
    """Return the axis with the largest value."""
    axis = max(range(3), key=lambda i: abs(values[i]))
    return Axis(_AXES[axis], values[axis])


def judge_axis(step: str, values: Sequence[float], wanted: str, minimum: float) -> CheckResult:
    """Check which axis responded to a motion by hand; ``minimum`` is the minimum response."""
    axis = strongest(values)
    if abs(axis.value) < minimum:
        return left_out(step, "no motion was measured")
    if axis.signed == wanted:
        return good(step, f"{wanted} responds")
    text = f"{axis.signed} responds, not {wanted}"
    advice = (
        "this axis is reversed"
        if axis.name == wanted[1]
        else "the axes of the IMU are rotated; mount it, or map them, as PROTOCOL.md specifies"
    )
    return wrong(step, text, advice)


# ---- supply -----------------------------------------------------------------------------


def judge_power(
    battery_v: float, logic_v: float, currents_a: tuple[float, float], nominal_v: float
) -> list[CheckResult]:
    """Check the supply voltages, and the motor currents at standstill."""
    low, high = (1.0 - BATTERY_SHARE) * nominal_v, (1.0 + BATTERY_SHARE) * nominal_v
    found = [
        good("battery", f"{battery_v:.2f} V")
        if low <= battery_v <= high
        else wrong(
            "battery",
            f"{battery_v:.2f} V, not about {nominal_v:g} V",
            "check the voltage divider and the battery",
        ),
        good("logic supply", f"{logic_v:.2f} V")
        if LOGIC_V[0] <= logic_v <= LOGIC_V[1]
        else wrong("logic supply", f"{logic_v:.2f} V, not 5 V", "check the regulator"),
    ]
    for side, current_a in zip((LEFT, RIGHT), currents_a, strict=True):
        if current_a > IDLE_A:
            text = f"{current_a:.2f} A with the motors off"
            advice = "check the sense resistor, and look for a short circuit"
            found.append(wrong(f"motor {side} current", text, advice))
    return found
