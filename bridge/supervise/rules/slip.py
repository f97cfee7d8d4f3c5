"""Slip: the wheels tell another way than gyro and ultrasonic sensor do.

A wheel that slips alone shows against the gyro. Both slipping alike show against the range
ahead: on a straight run towards whatever reflects, it closes by the way that was really made.
A range that does not close is slip, or a sensor that lies; either is worth a look, and which
of them it is cannot be told from there.
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
"""Way by the wheels over which the closing is judged: 5 mm of noise are then 2 % of it."""
MIN_READINGS = 12
HALF_SHARE = 0.6
"""Each half of the run must show so much of what the whole does: what slips does so evenly,
while an echo that wanders over a round column or past an edge bends."""
JUMP_M = 0.03
"""From reading to reading beyond the way made: another thing reflects now."""
STRAIGHT_RAD = 0.06
"""On a run that bends by more, the cone sweeps over other things."""
FAR_M = 3.5
"""Near the end of its range the sensor loses the echo now and then."""


class Slip:
    """Wheels against gyro, and wheels against the range ahead."""

    grave = False
    _turn_rad: float
    """Heading as the run began."""
    _slip_m_s: float

    def __init__(self, rule: SlipRule) -> None:
        """Keep the limits."""
        self._rule = rule
        self._readings: deque[tuple[float, float]] = deque()
        self.restart()

    def restart(self) -> None:
        """Nothing is known."""
        self._forget()

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Take a step; whether either pair disagrees."""
        self._slip_m_s = measured.slip_m_s
        if measured.new_range:
            self._see(inputs, measured)
        rule = self._rule
        return abs(self._slip_m_s) > rule.difference_m_s or self._lost > rule.share

    def _see(self, inputs: RuleInputs, measured: Measured) -> None:
        range_m = None if inputs.range is None else inputs.range.ultrasonic_m
        if range_m is None or range_m > FAR_M:
            self._forget()
            return
        readings = self._readings
        if readings and not self._goes_on(range_m, measured):
            self._forget()
        if not readings:
            self._turn_rad = measured.turn_rad
        elif measured.distance_m == readings[-1][0]:
            return  # it stands: nothing to be learnt
        readings.append((measured.distance_m, range_m))
        if measured.distance_m - readings[0][0] >= RUN_M and len(readings) >= MIN_READINGS:
            self._lost = _lost(list(readings))
            readings.popleft()

    def _forget(self) -> None:
        """No run is under way."""
        self._readings.clear()
        self._lost = 0.0

    def _goes_on(self, range_m: float, measured: Measured) -> bool:
        """Whether it drives straight ahead, towards the same thing as at the last reading."""
        distance_m, before_m = self._readings[-1]
        made_m = measured.distance_m - distance_m
        straight = abs(measured.turn_rad - self._turn_rad) <= STRAIGHT_RAD
        return straight and made_m >= 0.0 and abs(before_m - range_m) <= JUMP_M + made_m

    def evidence(self) -> Evidence:
        """Which pair, and by how much."""
        if abs(self._slip_m_s) > self._rule.difference_m_s:
            side = "right" if self._slip_m_s > 0.0 else "left"
            text = (
                f"wheels and gyro differ by {100 * abs(self._slip_m_s):.0f} cm/s: "
                f"the {side} wheel is ahead of what the body turns"
            )
            return text, {"by": "gyro", "difference_m_s": round(self._slip_m_s, 4)}
        text = (
            f"the range ahead closes by {100 * (1.0 - self._lost):.0f} % of the wheels' way: "
            "the wheels slip, what is ahead moves, or the ultrasonic sensor does not tell the truth"
        )
        return text, {"by": "ultrasonic", "lost_share": round(self._lost, 3)}


def _lost(points: list[tuple[float, float]]) -> float:
    """Share of the way by which the range did not close; 0 where the halves do not agree."""
    whole = 1.0 + _slope(points)
    middle = len(points) // 2
    halves = 1.0 + _slope(points[:middle]), 1.0 + _slope(points[middle:])
    return whole if min(halves) > HALF_SHARE * whole else 0.0


def _slope(points: list[tuple[float, float]]) -> float:
    """Least-squares slope of range over way: -1 where the range closes by all of it."""
    count = len(points)
    mean_x = sum(x for x, _ in points) / count
    across = sum((x - mean_x) * y for x, y in points)
    square = sum((x - mean_x) ** 2 for x, _ in points)
    return across / square
