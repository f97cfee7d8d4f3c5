"""What bring-up saw, judged: which wire is where, and which way round. Pure.

Signs are those of PROTOCOL.md: counts rise forwards, x ahead, y to the left, z up, yaw rate
counter-clockwise positive, acceleration at rest +1 g upwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import fmean, pstdev
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

GRAVITY_M_S2 = 9.80665
GRAVITY_OFF_M_S2 = 1.0
"""0.1 g: a chip's own bias and a stand that is not level."""
GYRO_REST_RAD_S = math.radians(20.0)
"""Greatest rate at rest by the data sheet (PS-MPU-6000A-00, section 6.1)."""
MIN_COUNTS = 30
"""A kick makes hundreds; a wheel dragged along by its neighbour's shaking a few."""
BATTERY_SHARE = 0.3
LOGIC_V = (4.6, 5.4)
IDLE_A = 0.2
_AXES = ("x", "y", "z")
LEFT, RIGHT = "left", "right"


@dataclass(frozen=True, slots=True)
class Finding:
    """What one look said."""

    step: str
    ok: bool | None
    """None: it was left out."""
    text: str
    advice: str = ""
    """What to do about it."""
    swapped: str = ""
    """Which plugs are swapped, ``motor`` or ``encoder``; empty: none."""

    @property
    def line(self) -> str:
        """In one line."""
        sign = {True: "ok", False: "WRONG", None: "left out"}[self.ok]
        tail = f"; {self.advice}" if self.advice else ""
        return f"{self.step}: {sign}: {self.text}{tail}"


def good(step: str, text: str) -> Finding:
    """All is well."""
    return Finding(step, ok=True, text=text)


def wrong(step: str, text: str, advice: str) -> Finding:
    """Something is not as it should be."""
    return Finding(step, ok=False, text=text, advice=advice)


def left_out(step: str, text: str, advice: str = "") -> Finding:
    """Nothing can be said."""
    return Finding(step, ok=None, text=text, advice=advice)


class Kick(NamedTuple):
    """One motor output driven forwards for a moment."""

    output: str
    """``left`` or ``right``: which output had the duty."""
    turned: str
    """Which wheel turned, as a person saw it: ``left``, ``right`` or ``none``."""
    forwards: bool
    left_counts: int
    right_counts: int


def judge_kicks(kicks: Sequence[Kick]) -> list[Finding]:
    """Name motor outputs and encoders that are swapped or the wrong way round.

    A person's eye says which wheel turned and which way: outputs and encoders that are both
    swapped look right to any program, and the robot would turn the wrong way.
    """
    found: list[Finding] = []
    for kick in kicks:
        found += _judge_motor(kick)
        if kick.turned != "none":
            found += _judge_encoder(kick)
    swapped = [f.swapped for f in found if f.swapped]
    if len(swapped) > 1:  # both sides say the same: once is enough
        found = [f for f in found if not f.swapped]
        found += [_swapped(what, f"{what}s") for what in sorted(set(swapped))]
    return found


_SWAP_ADVICE = {
    "motor": "cross the two motor plugs (or OUT1/2 with OUT3/4 at the bridge)",
    "encoder": "cross the two encoder plugs",
}


def _swapped(what: str, step: str) -> Finding:
    text = "left and right are swapped"
    return Finding(step, ok=False, text=text, advice=_SWAP_ADVICE[what], swapped=what)


def _judge_motor(kick: Kick) -> list[Finding]:
    step = f"motor {kick.output}"
    if kick.turned == "none":
        return [
            wrong(
                step,
                "neither wheel turned",
                "look at the bridge's enable input, its supply and the motor's plug",
            )
        ]
    found = []
    if kick.turned != kick.output:
        found.append(_swapped("motor", step))
    if not kick.forwards:
        advice = f"turn the plug of the {kick.turned} wheel's motor round"
        found.append(wrong(step, "turns backwards", advice))
    return found or [good(step, f"turns the {kick.turned} wheel forwards")]


def _judge_encoder(kick: Kick) -> list[Finding]:
    wheel = kick.turned
    step = f"encoder {wheel}"
    counts = {LEFT: kick.left_counts, RIGHT: kick.right_counts}
    other = RIGHT if wheel == LEFT else LEFT
    own, others = counts[wheel], counts[other]
    found = []
    if abs(own) < MIN_COUNTS and abs(others) < MIN_COUNTS:
        advice = "look at the encoder's plug and its supply"
        return [wrong(step, f"counts nothing ({own})", advice)]
    if abs(others) > 2 * abs(own):
        found.append(_swapped("encoder", step))
        own = others
    if (own > 0) is not kick.forwards:
        text = f"counts down forwards ({own:+d})"
        advice = f"swap channels A and B of the {wheel} wheel's encoder"
        found.append(wrong(step, text, advice))
    return found or [good(step, f"counts {own:+d}")]


# ---- at rest ----------------------------------------------------------------------------


class ImuSample(NamedTuple):
    """Accelerations (m/s²) and rates (rad/s) of one reading."""

    accel: tuple[float, float, float]
    gyro: tuple[float, float, float]


def judge_rest(samples: Sequence[ImuSample]) -> list[Finding]:
    """Judge the inertial sensor on a robot that stands level and still."""
    if not samples:
        advice = "look at the chip's supply and its bus"
        return [wrong("imu", "no readings", advice)]
    accel = [fmean(s.accel[i] for s in samples) for i in range(3)]
    gyro = [fmean(s.gyro[i] for s in samples) for i in range(3)]
    found = []
    size = math.sqrt(sum(a * a for a in accel))
    shown = ", ".join(f"{a:+.2f}" for a in accel)
    if abs(size - GRAVITY_M_S2) > GRAVITY_OFF_M_S2:
        text = f"feels {size:.2f} m/s² at rest, not 9.81 ({shown})"
        advice = "is its range set to ±2 g?"
        found.append(wrong("imu gravity", text, advice))
    else:
        found.append(_judge_up(accel, shown))
    fastest = max(range(3), key=lambda i: abs(gyro[i]))
    rate = math.degrees(gyro[fastest])
    if abs(gyro[fastest]) > GYRO_REST_RAD_S:
        text = f"{_AXES[fastest]} tells {rate:+.1f} °/s at rest"
        advice = "does the robot stand still? else the chip is broken, or its range is not ±250 °/s"
        found.append(wrong("imu rates", text, advice))
    else:
        text = f"at most {rate:+.2f} °/s at rest ({_AXES[fastest]})"
        found.append(good("imu rates", text))
    if len(samples) > 1 and all(
        pstdev(s.accel[i] for s in samples) == 0.0 and pstdev(s.gyro[i] for s in samples) == 0.0
        for i in range(3)
    ):
        text = "its readings never change by a step"
        advice = "a chip has noise: look at its bus"
        found.append(left_out("imu noise", text, advice))
    return found


def _judge_up(accel: Sequence[float], shown: str) -> Finding:
    axis = max(range(3), key=lambda i: abs(accel[i]))
    sign = "+" if accel[axis] > 0.0 else "-"
    name = f"{sign}{_AXES[axis]}"
    if name == "+z":
        return good("imu gravity", f"z is up ({shown} m/s²)")
    advice = "the chip lies on its back" if name == "-z" else "the chip stands on edge"
    text = f"the chip's {name} is up, not +z ({shown} m/s²)"
    return wrong(
        "imu gravity", text, f"{advice}: mount it, or map its axes, as PROTOCOL.md has them"
    )


# ---- by hand ----------------------------------------------------------------------------


class Axis(NamedTuple):
    """One axis of a sensor."""

    name: str
    value: float

    @property
    def signed(self) -> str:
        """``+x`` to ``-z``."""
        return f"{'+' if self.value > 0.0 else '-'}{self.name}"


def strongest(values: Sequence[float]) -> Axis:
    """The axis that moved most."""
    axis = max(range(3), key=lambda i: abs(values[i]))
    return Axis(_AXES[axis], values[axis])


def judge_axis(step: str, values: Sequence[float], wanted: str, least: float) -> Finding:
    """Judge which axis answered to a motion by hand; ``least`` is what counts as an answer."""
    axis = strongest(values)
    if abs(axis.value) < least:
        return left_out(step, "no motion was felt")
    if axis.signed == wanted:
        return good(step, f"{wanted} answers")
    text = f"{axis.signed} answers, not {wanted}"
    advice = (
        "that axis is the wrong way round"
        if axis.name == wanted[1]
        else "the chip's axes are turned: mount it, or map them, as PROTOCOL.md has them"
    )
    return wrong(step, text, advice)


# ---- supply -----------------------------------------------------------------------------


def judge_power(
    battery_v: float, logic_v: float, currents_a: tuple[float, float], nominal_v: float
) -> list[Finding]:
    """Judge the rails and the currents at rest."""
    low, high = (1.0 - BATTERY_SHARE) * nominal_v, (1.0 + BATTERY_SHARE) * nominal_v
    found = [
        good("battery", f"{battery_v:.2f} V")
        if low <= battery_v <= high
        else wrong(
            "battery",
            f"{battery_v:.2f} V, not about {nominal_v:g} V",
            "look at the divider before the converter, and at the battery",
        ),
        good("logic supply", f"{logic_v:.2f} V")
        if LOGIC_V[0] <= logic_v <= LOGIC_V[1]
        else wrong("logic supply", f"{logic_v:.2f} V, not 5 V", "look at the regulator"),
    ]
    for side, current_a in zip((LEFT, RIGHT), currents_a, strict=True):
        if current_a > IDLE_A:
            text = f"{current_a:.2f} A with the motors off"
            advice = "look at the sense resistor and for a short"
            found.append(wrong(f"motor {side} current", text, advice))
    return found
