"""Step response of the device's wheel control, measured by the encoders. No I/O."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from bridge.bringup.wiring import CheckResult, good, wrong
from bridge.motion.estimation.odometry import encoder_delta
from bridge.motion.step_response import StepResponse

if TYPE_CHECKING:
    from collections.abc import Sequence

WINDOW_S = 0.04
"""Averaging time of a speed, s. Over only 10 ms, one count would be 13 mm/s."""
STEADY_S = 0.4
"""Time at the end of the step that counts as steady state, s."""
STEADY_SHARE = 0.06
"""Maximum normal steady-state error, relative to the target."""
OVERSHOOT_SHARE = 0.30
"""Maximum normal overshoot, relative to the target."""
SETTLED_S = 0.8
"""Maximum normal settling time, s."""
BAND_SHARE = 0.12
"""Half of the settling band's width, relative to the target. One count is 2 % at 0.15 m/s."""


class WheelStep(NamedTuple):
    """Response of one wheel to a step of its setpoint."""

    wheel: str
    response: StepResponse
    """Response with the time from the step (s), the speed (m/s), and the target as its command."""

    @property
    def steady_m_s(self) -> float:
        """Mean speed at the end of the step."""
        times, values = self.response.time_s, self.response.value
        last = [v for t, v in zip(times, values, strict=True) if t > times[-1] - STEADY_S]
        return sum(last) / len(last)

    @property
    def rise_s(self) -> float:
        """Rise time from 10 to 90 % of the target, s; inf: the speed did not reach 90 %."""
        return self.response.rise_s

    @property
    def overshoot(self) -> float:
        """Overshoot, relative to the target."""
        return self.response.overshoot

    @property
    def settled_s(self) -> float:
        """Settling time to within 12 % of the target, s."""
        return self.response.settled_s(BAND_SHARE * abs(self.response.target))


def wheel_speeds(
    samples: Sequence[tuple[float, int, int]], metres_per_count: float
) -> list[tuple[float, float, float]]:
    """Return device time (s) and both wheels' mean speeds over 40 ms (m/s) at each sample."""
    found = []
    for i, (t_s, left, right) in enumerate(samples):
        j = i
        while j > 0 and samples[j][0] > t_s - WINDOW_S + 1e-9:
            j -= 1
        before_s, before_left, before_right = samples[j]
        dt_s = t_s - before_s
        if dt_s <= 0.0:
            continue
        found.append(
            (
                t_s,
                metres_per_count * encoder_delta(before_left, left) / dt_s,
                metres_per_count * encoder_delta(before_right, right) / dt_s,
            )
        )
    return found


def wheel_steps(
    samples: Sequence[tuple[float, int, int]],
    step_s: float,
    target_m_s: float,
    metres_per_count: float,
) -> tuple[WheelStep, WheelStep]:
    """Return both wheels' responses to a step at the device time ``step_s``.

    Raises:
        ValueError: there are no samples after the step.

    """
    speeds = [row for row in wheel_speeds(samples, metres_per_count) if row[0] >= step_s]
    if not speeds:
        raise ValueError("no encoder readings after the step")
    times = [t - step_s for t, _, _ in speeds]
    commands = [target_m_s] * len(times)
    left = StepResponse(times, [row[1] for row in speeds], commands, target_m_s)
    right = StepResponse(times, [row[2] for row in speeds], commands, target_m_s)
    return WheelStep("left", left), WheelStep("right", right)


def judge_step(step: WheelStep) -> CheckResult:
    """Evaluate a wheel's control, and recommend a change of its gains if needed."""
    name = f"wheel control {step.wheel}"
    target = step.response.target
    error = step.steady_m_s / target - 1.0
    figures = (
        f"rise time {_seconds(step.rise_s)}, overshoot {100 * step.overshoot:.0f} %, "
        f"settling time {_seconds(step.settled_s)}, error at the end {100 * error:+.1f} %"
    )
    if abs(step.steady_m_s) < 0.1 * abs(target):
        return wrong(
            name, f"the wheel does not follow: {figures}", "check the motor and the encoder"
        )
    if error < -1.5:  # noqa: PLR2004 - faster than the setpoint, in the opposite direction
        return wrong(name, f"the wheel runs away: {figures}", "reverse the motor or the encoder")
    if abs(error) > STEADY_SHARE:
        return wrong(
            name,
            figures,
            "the wheel does not reach its speed; increase the integral or feed-forward gain",
        )
    if step.overshoot > OVERSHOOT_SHARE:
        return wrong(name, figures, "decrease the proportional or integral gain")
    if step.settled_s > SETTLED_S:
        return wrong(name, figures, "the wheel settles too slowly; see docs/tuning.md")
    return good(name, figures)


def _seconds(value: float) -> str:
    return "unknown" if math.isinf(value) else f"{value:.2f} s"


def as_text(steps: Sequence[WheelStep], *, width: int = 64, height: int = 12) -> str:
    """Plot both wheels as text: l and r, x if both are equal, dashes for the target."""
    target = steps[0].response.target
    end_s = max(step.response.time_s[-1] for step in steps)
    top = 1.25 * max([abs(target), *(abs(v) for s in steps for v in s.response.value)])
    rows = [[" "] * width for _ in range(height)]

    def row(value: float) -> int:
        share = math.copysign(1.0, target) * value / top
        return min(height - 1, max(0, height - 1 - round(share * (height - 1))))

    rows[row(target)] = ["-"] * width
    for step in steps:
        mark = step.wheel[0]
        for t, v in zip(step.response.time_s, step.response.value, strict=True):
            column = min(width - 1, int(t / end_s * (width - 1)))
            at = rows[row(v)]
            at[column] = mark if at[column] in {" ", "-", mark} else "x"
    lines = [f"{'':8}{''.join(r)}" for r in rows]
    lines[0] = f"{math.copysign(top, target):+7.3f} " + lines[0][8:]
    lines[row(target)] = f"{target:+7.3f} " + lines[row(target)][8:]
    lines[-1] = f"{0.0:7.3f} " + lines[-1][8:]
    axis = f"{'m/s':>7} {'0':<{width - 8}}{end_s:6.2f} s"
    return "\n".join([*lines, axis])
