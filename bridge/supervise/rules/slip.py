"""Slip: the wheels measure another motion than the gyro or the ultrasonic sensor.

The gyro shows slip of one wheel. The range ahead shows equal slip of both wheels. On a straight run
the range must decrease by the driven distance. Otherwise the wheels slip or the sensor is faulty.
This rule cannot distinguish the two causes, but both must be reported.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bridge.supervise.inputs import RuleInputs
    from bridge.supervise.measured import Measured
    from bridge.supervise.rules.conditions import Evidence
    from bridge.supervise.settings import SlipRule

RUN_M = 0.30
"""Length of a straight run for one comparison, m. The range noise of 5 mm is 2 % of this length."""
MIN_READINGS = 12
"""Minimum number of range samples in a run."""
HALF_SHARE = 0.6
"""Minimum slip of each half of a run, as a share of the whole run's slip. Real slip is uniform. The
apparent slip is not uniform if the echo moves along a round column or past an edge."""
JUMP_M = 0.03
"""Maximum difference between the change of the range and the driven distance, m. A larger
difference is caused by another object."""
STRAIGHT_RAD = 0.06
"""Maximum turn in a run, rad. After a larger turn, the sensor's cone covers other objects."""
FAR_M = 3.5
"""Maximum range that is used, m. Near the sensor's maximum range, some echoes are lost."""


class RangeRun:
    """A straight run towards an object.

    It compares the change of the range with the wheels' distance.
    """

    _turn_rad: float
    """Heading at the start of the run, rad."""

    def __init__(self, run_m: float, min_readings: int) -> None:
        """Compare over this distance, m, with at least this number of readings."""
        self._run_m, self._min_readings = run_m, min_readings
        self._readings: deque[tuple[float, float]] = deque()
        self.lost = 0.0
        """Share of the wheels' distance by which the range did not decrease; 0 before a complete
        run."""

    def forget(self) -> None:
        """Discard the current run."""
        self._readings.clear()
        self.lost = 0.0

    def see(self, inputs: RuleInputs, measured: Measured) -> None:
        """Handle a new range sample."""
        range_m = None if inputs.range is None else inputs.range.ultrasonic_m
        if range_m is None or range_m > FAR_M:
            self.forget()
            return
        readings = self._readings
        if readings and not self._is_same_run(range_m, measured):
            self.forget()
        if not readings:
            self._turn_rad = measured.turn_rad
        elif measured.distance_m == readings[-1][0]:
            return  # no motion, no information
        readings.append((measured.distance_m, range_m))
        run_m = measured.distance_m - readings[0][0]
        if run_m >= self._run_m and len(readings) >= self._min_readings:
            self.lost = _lost(list(readings))
            readings.popleft()

    def _is_same_run(self, range_m: float, measured: Measured) -> bool:
        """Return True if the robot drives straight ahead towards the same object."""
        distance_m, before_m = self._readings[-1]
        made_m = measured.distance_m - distance_m
        straight = abs(measured.turn_rad - self._turn_rad) <= STRAIGHT_RAD
        return straight and made_m >= 0.0 and abs(before_m - range_m) <= JUMP_M + made_m


class Slip:
    """Compares the wheels with the gyro and with the range ahead."""

    grave = False
    _slip_m_s: float

    def __init__(self, rule: SlipRule) -> None:
        """Set the limits."""
        self._rule = rule
        self._run = RangeRun(RUN_M, MIN_READINGS)

    def restart(self) -> None:
        """Discard the current run."""
        self._run.forget()

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Evaluate a control step; return True if one of the comparisons fails."""
        self._slip_m_s = measured.slip_m_s
        if not measured.step_s:  # the path in a gap is unknown
            self._run.forget()
        if measured.new_range:
            self._run.see(inputs, measured)
        rule = self._rule
        return abs(self._slip_m_s) > rule.difference_m_s or self._run.lost > rule.share

    def evidence(self) -> Evidence:
        """Return the failed comparison and its size."""
        if abs(self._slip_m_s) > self._rule.difference_m_s:
            side = "right" if self._slip_m_s > 0.0 else "left"
            text = (
                f"wheels and gyro differ by {100 * abs(self._slip_m_s):.0f} cm/s: "
                f"the {side} wheel leads the gyro's turn"
            )
            return text, {"by": "gyro", "difference_m_s": round(self._slip_m_s, 4)}
        text = (
            f"the range ahead decreases by {100 * (1.0 - self._run.lost):.0f} % of the wheel "
            "distance: the wheels slip, the object ahead moves, or the ultrasonic sensor is wrong"
        )
        return text, {"by": "ultrasonic", "lost_share": round(self._run.lost, 3)}


def _lost(points: list[tuple[float, float]]) -> float:
    """Return the share of the distance by which the range did not decrease; 0: halves differ."""
    whole = 1.0 + _slope(points)
    middle = len(points) // 2
    halves = 1.0 + _slope(points[:middle]), 1.0 + _slope(points[middle:])
    return whole if min(halves) > HALF_SHARE * whole else 0.0


def _slope(points: list[tuple[float, float]]) -> float:
    """Return the least-squares slope of range over distance: -1 without slip."""
    count = len(points)
    mean_x = sum(x for x, _ in points) / count
    across = sum((x - mean_x) * y for x, y in points)
    square = sum((x - mean_x) ** 2 for x, _ in points)
    return across / square
