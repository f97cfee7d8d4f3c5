"""Check of the device's planner against the measured motion and the paper's rules.

The symbols are the paper's: D and Prev-D are the distances of this lane and the previous lane, Φ is
the footprint's diameter, W the mouth's width, T the number of turns. At the end of a lane the check
compares D with the odometry. It recomputes the case from D, Prev-D and Φ, and Length from W and T.
Between decisions it compares the reported phase with the measured motion. After each check it
continues from the device's own values, so one error causes only one finding.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from protocol.messages.values import Contact, PlannerPhase, label

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel
    from bridge.supervise.inputs import RuleInputs, Scalar
    from bridge.supervise.measured import Measured
    from bridge.supervise.rules.conditions import Evidence
    from bridge.supervise.settings import DisagreementRule
    from protocol.messages.device import PlannerState

_LANE, _TURN, _STEP = PlannerPhase.LANE, PlannerPhase.TURN, PlannerPhase.STEP
_STILL = frozenset(
    {PlannerPhase.IDLE, PlannerPhase.PAUSED, PlannerPhase.FINISHED, PlannerPhase.ABORTED}
)
_STRAIGHT = frozenset({_LANE, _STEP})
_LANES = frozenset({"paper", "u-shape"})
"""Planners with straight lanes, which report D, Prev-D and T."""
_BUMPERS = int(Contact.BUMPER_LEFT | Contact.BUMPER_RIGHT)
GAP_S = 0.7
"""Maximum time between two planner states, s. They arrive at 5 Hz. A longer gap may hide a
decision."""
KEEP_S = 2.0
"""Time for which a finding persists, s. The rule reacts in this time."""
_MM = 0.001 + 1e-9
"""Maximum error of the difference of two values that are rounded to a millimetre, m."""
_LENGTH_STEP_M = 0.02
"""Resolution of Length in the message, m."""
_LENGTH_MOST = 255
"""Maximum raw value of Length. It represents this length or any greater length."""
STANDS_M_S, STANDS_RAD_S = 0.03, 0.15
"""Minimum speed (m/s) and yaw rate (rad/s) that count as motion: three times the estimate's noise
at standstill."""
SLIPS_M_S = 0.012
"""Minimum slip that makes the distance uncertain, m/s. It is twice the slip on a hard floor."""
TURN_M = 0.06
"""Maximum speed during a turn in place, m/s."""
ARC_WIDTHS = 1.0
"""Maximum radius of a turn on an arc, in widths of the mouth. Planners with straight lanes turn in
place."""
BEND_RAD = 0.6
"""Maximum yaw rate on a straight segment, rad/s."""


@dataclass(slots=True)
class _Lane:
    """A lane: its start and its length so far."""

    since_s: float
    began_m: float
    """Odometry at the start, m."""
    far_m: float
    """Maximum odometry since the start, m."""
    start: Pose2
    """Estimated pose at the start."""
    made_m: float = 0.0
    """Maximum distance along the lane by the estimate, m. After a bump the wheels may still
    turn."""
    uncertain_m: float = 0.0
    """Part of the distance with slip or a push, m. The odometry of this part is unreliable."""


class PlannerCheck:
    """Checks the device's planner; inactive if the host plans."""

    grave = False
    _state_s: float
    """Time of the newest planner state, s."""
    _found_s: float
    _claim_s: float
    _mark_m: float
    _mark_rad: float
    """Time, odometry (m) and turn (rad) at the last check of the reported phase."""

    def __init__(self, rule: DisagreementRule, model: RobotModel) -> None:
        """Set the limits."""
        self._rule = rule
        self._diameter_m = model.robot_diameter_m
        self._width_m = model.cleaning_width_m
        self.restart()

    def restart(self) -> None:
        """Accept the next state without a check."""
        self._state: PlannerState | None = None
        self._lane: _Lane | None = None
        self._found: Evidence | None = None

    # ---- control step -----------------------------------------------------------------------

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Evaluate a control step; return True if there is a recent finding."""
        reported, now_s = inputs.planner, inputs.time_s
        if reported is None or not inputs.onboard:
            return False
        if self._lane is not None:
            _go_on(self._lane, inputs, measured)
        if reported is not self._state:
            self._take_state(reported, inputs, measured)
        self._test_claim(reported, inputs, measured)
        if self._found is not None and now_s - self._found_s > KEEP_S:
            self._found = None
        return self._found is not None

    def evidence(self) -> Evidence:
        """Return the newest finding."""
        return self._found or ("", {})

    def _note(self, now_s: float, text: str, **data: Scalar) -> None:
        self._found, self._found_s = (text, data), now_s

    # ---- decisions --------------------------------------------------------------------------

    def _take_state(self, reported: PlannerState, inputs: RuleInputs, measured: Measured) -> None:
        before, now_s = self._state, inputs.time_s
        whole = before is not None and now_s - self._state_s <= GAP_S
        self._state, self._state_s = reported, now_s
        if before is None or reported.phase != before.phase:
            self._claim_s = now_s
            self._mark_m, self._mark_rad = measured.travel_m, measured.turn_rad
        if inputs.onboard in _LANES and before is not None and whole:
            if before.phase == _LANE and reported.phase != _LANE and reported.phase not in _STILL:
                self._judge(before, reported, now_s, paper=inputs.onboard == "paper")
            elif reported.turn_count > before.turn_count + 1:
                text = f"T went from {before.turn_count} to {reported.turn_count} in one step"
                self._note(now_s, text, T=reported.turn_count, T_before=before.turn_count)
        if reported.phase != _LANE:
            # A turn in place has no distance, so the lane starts at the end of the turn.
            self._lane = _Lane(now_s, measured.distance_m, measured.distance_m, inputs.pose)
        elif not whole:
            self._lane = None

    def _judge(
        self, before: PlannerState, reported: PlannerState, now_s: float, *, paper: bool
    ) -> None:
        distance_m, lane = reported.lane_distance_m, self._lane
        if lane is not None:
            lengths_m = lane.far_m - lane.began_m, lane.made_m
            driven_m = min(lengths_m, key=lambda path_m: abs(distance_m - path_m))
            if abs(distance_m - driven_m) > self._rule.distance_m + lane.uncertain_m:
                self._note(
                    now_s,
                    f"the device reports D = {distance_m:.3f} m, odometry is {driven_m:.3f} m",
                    D_m=distance_m,
                    odometry_m=round(driven_m, 3),
                    for_s=round(now_s - lane.since_s, 2),
                )
        previous_m = before.lane_distance_m
        first = not (before.lane_distance or before.lane_case or before.turn_count)
        if reported.previous_lane_distance not in {reported.lane_distance, before.lane_distance}:
            self._note(
                now_s,
                f"the device reports Prev-D = {reported.previous_lane_distance_m:.3f} m, "
                f"but reported D = {previous_m:.3f} m for the lane before",
                Prev_D_m=reported.previous_lane_distance_m,
                D_before_m=previous_m,
            )
        if paper:
            self._judge_case(reported, distance_m if first else previous_m, now_s)

    def _judge_case(self, reported: PlannerState, previous_m: float, now_s: float) -> None:
        distance_m, case = reported.lane_distance_m, reported.lane_case
        # At a limit between two cases, both are valid.
        cases = {self._case(distance_m, previous_m + off) for off in (-_MM, 0.0, _MM)}
        if case not in cases:
            expected = min(cases)
            self._note(
                now_s,
                f"the device reports case {case}, but D = {distance_m:.3f} m after "
                f"{previous_m:.3f} m is case {expected}",
                case=case,
                expected=expected,
                D_m=distance_m,
                Prev_D_m=previous_m,
            )
        elif case == 3 and reported.length != _LENGTH_MOST:  # noqa: PLR2004 - the paper's case number
            length_m = self._width_m * reported.turn_count
            if abs(reported.length_m - length_m) > 0.5 * _LENGTH_STEP_M + _MM:
                self._note(
                    now_s,
                    f"the device reports Length = {reported.length_m:.2f} m, "
                    f"but W·T is {length_m:.2f} m",
                    Length_m=reported.length_m,
                    expected_m=round(length_m, 3),
                    T=reported.turn_count,
                )

    def _case(self, distance_m: float, previous_m: float) -> int:
        """Return the paper's case of a lane after the previous lane; 0: no case."""
        if distance_m + self._diameter_m < previous_m:
            return 2
        if distance_m - self._diameter_m > previous_m:
            return 3
        return 1 if abs(distance_m - previous_m) <= self._rule.equal_m else 0

    # ---- reported phase ---------------------------------------------------------------------

    def _test_claim(self, reported: PlannerState, inputs: RuleInputs, measured: Measured) -> None:
        """Compare the reported phase with the motion since the last check."""
        now_s, rule = inputs.time_s, self._rule
        for_s = now_s - self._claim_s
        if for_s < rule.motion_s:
            return
        path_m = measured.travel_m - self._mark_m
        turn_rad = measured.turn_rad - self._mark_rad
        self._claim_s = now_s
        self._mark_m, self._mark_rad = measured.travel_m, measured.turn_rad
        phase = reported.phase
        wrong = ""
        if phase in _STILL:
            if path_m > STANDS_M_S * for_s or abs(turn_rad) > STANDS_RAD_S * for_s:
                wrong = "moves"
        elif inputs.onboard in _LANES and phase in _STRAIGHT:
            if abs(turn_rad) > BEND_RAD * for_s:
                wrong = "turns"
        elif phase == _TURN:
            radius_m = 0.0 if inputs.onboard in _LANES else ARC_WIDTHS * self._width_m
            if path_m > TURN_M * for_s + radius_m * abs(turn_rad):
                wrong = "drives"
        if wrong:
            name = label(PlannerPhase, phase).replace("_", " ")
            self._note(
                now_s,
                f"the device reports {name}, but it {wrong}: {100 * path_m:.0f} cm and "
                f"{turn_rad:.2f} rad in {for_s:.1f} s",
                phase=name,
                path_m=round(path_m, 3),
                turn_rad=round(turn_rad, 3),
                for_s=round(for_s, 2),
            )


def _go_on(lane: _Lane, inputs: RuleInputs, measured: Measured) -> None:
    """Extend a lane by one control step."""
    lane.far_m = max(lane.far_m, measured.distance_m)
    lane.made_m = max(lane.made_m, lane.start.along_m(inputs.pose))
    if abs(measured.slip_m_s) > SLIPS_M_S:
        lane.uncertain_m += abs(measured.slip_m_s) * measured.step_s
    reading = inputs.range
    if reading is not None and reading.contacts & _BUMPERS:
        lane.uncertain_m += 0.5 * abs(measured.left_m + measured.right_m)
