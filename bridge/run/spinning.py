"""Detection of wheels that turn while the robot stands still. No I/O.

The encoders of spinning wheels count a distance that the robot does not drive. The estimator and
the planner use this distance, so they do not detect the error. Three measurements show the error.
In a turn, the gyro measures no rotation. On a straight line, the range ahead stays constant. If
nothing is in range, the accelerometer measures that the robot stops while its wheels turn.
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
    """Limits that separate a robot with normal wheel slip from a robot that does not move.

    All values were tuned with the campaign ``tests/campaign/changes.py``. In its runs without
    faults, the check never stops the robot.
    """

    turn_rad: float = 1.0
    """Maximum difference between the turns that the wheels and the gyro measure, rad. Without a
    fault it reaches 0.2 rad (eight generated rooms at harsh noise)."""
    turn_s: float = 8.0
    """Time constant with which a difference decays, s. With 2 s, a robot that stops, backs off and
    turns again and again is detected after 11 s instead of 5 s."""
    run_m: float = 0.4
    """Distance, as the wheels measure it, after which the range ahead must be shorter, m."""
    min_readings: int = 12
    """Minimum number of range samples over the distance ``run_m``."""
    stand_s: float = 1.0
    """Minimum time for which the accelerometer measures standstill while the wheels turn, s."""
    stand_m_s: float = 0.1
    """Minimum wheel speed of the standstill check, m/s. At a lower speed its time restarts."""
    lost_share: float = 0.85
    """Share of a distance. The wheels spin if, over the distance ``run_m``, the range ahead
    decreases by less than (1 - ``lost_share``) of this distance."""


class SpinCheck:
    """Compares the wheels with gyro and ranges. Call :meth:`step` at least every 0.3 s."""

    def __init__(self, model: RobotModel, tuning: SpinTuning | None = None) -> None:
        """Start without motion."""
        self._tuning = tuning = tuning or SpinTuning()
        self._base_m = model.wheel_base_m
        self._measured = Measured(model)
        self._run = RangeRun(tuning.run_m, tuning.min_readings)
        self._excess_m = 0.0
        """Difference between the wheels' turn and the gyro's turn, m. It is (right - left distance)
        - gyro angle · wheel base, summed with decay."""
        self._stood_s = 0.0
        """Time of standstill without a contact while the wheels turn, s."""

    def restart(self) -> None:
        """Discard the measurements from before a gap."""
        self._measured.restart()
        self._run.forget()
        self._excess_m = self._stood_s = 0.0

    def step(self, inputs: RuleInputs, *, stands: bool) -> str | None:
        """Return the reason if the wheels seem to spin, else None.

        ``stands``: the accelerometer measures standstill while the wheels turn.
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
            self._run.forget()  # during a contact the wheels may slip for another reason
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
