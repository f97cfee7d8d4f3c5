"""Wheels that turn while the robot stays: found by the gyro and by the range ahead. Pure.

A robot with free-spinning wheels counts distance and goes nowhere, so neither its estimate nor its
planner ends the run. Turning shows it by the gyro; driving straight by a range that stays as it is.
Where nothing is in range ahead, the accelerometer feels that the robot stops while its wheels turn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bridge.supervise.measured import Measured
from bridge.supervise.rules.slip import RangeRun

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from bridge.supervise.inputs import RuleInputs


@dataclass(frozen=True, slots=True)
class SpinTuning:
    """Limits between a robot that slips and one that does not move.

    Source of all: ``campaign.changes``, with no stop in its runs without a fault.
    """

    turn_rad: float = 1.0
    """Turn by which wheels and gyro may differ within ``turn_s``, rad. Late samples: 0.06."""
    turn_s: float = 2.0
    """Time constant with which a difference is forgotten, s."""
    run_m: float = 0.4
    """Distance by the wheels over which the range ahead must decrease, m."""
    min_readings: int = 12
    """Number of range samples in it."""
    stand_s: float = 1.0
    """Time for which the accelerometer shows standstill while the wheels turn, s."""
    stand_m_s: float = 0.1
    """Speed of the wheels above which that time counts, m/s."""
    lost_share: float = 0.85
    """Share of that distance by which the range does not decrease."""


class SpinCheck:
    """Compares the wheels with gyro and range; take a step every 0.3 s or more often."""

    def __init__(self, model: RobotModel, tuning: SpinTuning | None = None) -> None:
        """Start without motion."""
        self._tuning = tuning = tuning or SpinTuning()
        self._base_m = model.wheel_base_m
        self._measured = Measured(model)
        self._run = RangeRun(tuning.run_m, tuning.min_readings)
        self._excess_m = 0.0
        """Distance by which the right wheel leads the gyro's turn, leaky, m."""
        self._stood_s = 0.0
        """Time of the standstill without a contact while the wheels turn, s."""

    def restart(self) -> None:
        """Discard what was measured before a gap."""
        self._measured.restart()
        self._run.forget()
        self._excess_m = self._stood_s = 0.0

    def step(self, inputs: RuleInputs, *, stands: bool) -> str | None:
        """Return why the wheels seem to spin; None: they do not.

        ``stands``: the accelerometer shows that the robot stands while its wheels turn.
        """
        tuning, measured = self._tuning, self._measured
        turned_rad = measured.turn_rad
        measured.step(inputs)
        if measured.step_s == 0.0:  # the first step, or a gap
            self._run.forget()
            self._excess_m = self._stood_s = 0.0
            return None
        wheels_m = measured.right_m - measured.left_m
        gyro_m = (measured.turn_rad - turned_rad) * self._base_m
        self._excess_m += wheels_m - gyro_m - measured.step_s / tuning.turn_s * self._excess_m
        touches = inputs.range is not None and inputs.range.contacts != 0
        if stands and not touches and abs(inputs.v_m_s) > tuning.stand_m_s:
            self._stood_s += measured.step_s
        else:
            self._stood_s = 0.0
        if touches:
            self._run.forget()  # wheels may slip while something holds the robot
        elif measured.new_range:
            self._run.see(inputs, measured)
        excess_rad = self._excess_m / self._base_m
        if abs(excess_rad) > tuning.turn_rad:
            return (
                f"wheels and gyro differ by {math.degrees(abs(excess_rad)):.0f}°: a wheel spins "
                "freely, something holds or turns the robot, or the gyro is wrong"
            )
        if self._stood_s > tuning.stand_s:
            return (
                f"the wheels turn at {100.0 * abs(inputs.v_m_s):.0f} cm/s without a contact, but "
                "the robot stands: they spin freely"
            )
        if self._run.lost > tuning.lost_share:
            return (
                f"the wheels turned by {100.0 * tuning.run_m:.0f} cm and the range ahead stayed: "
                "they spin freely, or the ultrasonic sensor is wrong"
            )
        return None
