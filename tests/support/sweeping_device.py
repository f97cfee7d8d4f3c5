"""A device that sweeps lanes and reports them, for tests of the planner check."""

from __future__ import annotations

from bridge.motion.geometry import Pose2
from bridge.supervise.rules.planner_check import PlannerCheck
from bridge.supervise.settings import DisagreementRule
from protocol.messages.device import PlannerState
from protocol.messages.values import PlannerPhase
from support.watching import MODEL, STEP_S, Walk, planner, reading

IDLE, LANE, TURN, STEP = (
    PlannerPhase.IDLE,
    PlannerPhase.LANE,
    PlannerPhase.TURN,
    PlannerPhase.STEP,
)
BACK = PlannerPhase.RECOVERY_BACK
PERIOD = 10
"""Number of control steps between two planner states, which arrive at 5 Hz."""
CRUISE_M = 0.2 * STEP_S


class Device:
    """A device that sweeps lanes and reports them; a test can falsify its reports."""

    def __init__(self, onboard: str = "paper", rule: DisagreementRule | None = None) -> None:
        self.planner_check = PlannerCheck(rule or DisagreementRule(motion_s=1.0), MODEL)
        self.walk = Walk(self.planner_check)
        self.onboard = onboard
        self.state = planner(IDLE)
        self.pose = Pose2(0.0, 0.0, 0.0)
        self.contacts = 0
        self.follow_pose = True
        self.found: list[str] = []

    def emit_state(self, state: PlannerState) -> None:
        self.state = state

    def go(
        self, steps: int, speed_m: float = 0.0, *, rate: float = 0.0, lead_m: float = 0.0
    ) -> None:
        """Run a number of control steps. Every tenth step sends a planner state, changed or not."""
        for index in range(steps):
            if index % PERIOD == 0:
                self.state = PlannerState(*tuple(self.state))
            turn_m = 0.5 * 0.23 * rate * STEP_S
            if self.follow_pose:
                x = self.pose.x_m + speed_m
                self.pose = Pose2(x, self.pose.y_m, 0.0)
            self.walk.step(
                1,
                left_m=speed_m - turn_m,
                right_m=speed_m + turn_m + lead_m,
                yaw_rate_rad_s=rate,
                pose=self.pose,
                planner=self.state,
                onboard=self.onboard,
                range=reading(contacts=self.contacts),
            )
            text, _ = self.planner_check.evidence()
            if self.walk.held and text not in self.found:
                self.found.append(text)

    def lane(
        self, path_m: float, after: PlannerState, *, before: PlannerState | None = None
    ) -> None:
        """Sweep a lane of this length; the state after it reports the lane."""
        self.emit_state(before or planner(LANE, turns=self.state.turn_count, **_kept(self.state)))
        self.go(round(path_m / CRUISE_M), CRUISE_M)
        self.go(30)  # the rest at the lane's end
        self.emit_state(after)
        self.go(20, rate=0.8)

    @property
    def data(self) -> dict[str, object]:
        return dict(self.planner_check.evidence()[1])


def _kept(state: PlannerState) -> dict[str, int]:
    return {
        "distance": state.lane_distance,
        "previous": state.previous_lane_distance,
        "length": state.length,
        "case": state.lane_case,
    }


def started(onboard: str = "paper", rule: DisagreementRule | None = None) -> Device:
    device = Device(onboard, rule)
    device.go(30)
    return device


def swept(path_m: float = 1.0, *, turns: int = 1, case: int = 1) -> Device:
    """Return a device after a first lane, correctly reported, and a side step."""
    device = started()
    mm = round(path_m * 1000)
    device.lane(path_m, planner(TURN, distance=mm, previous=mm, case=case))
    device.emit_state(planner(STEP, distance=mm, previous=mm, case=case))
    device.go(40, CRUISE_M)
    device.emit_state(planner(TURN, turns=turns, distance=mm, previous=mm, case=case))
    device.go(40, rate=0.8)
    assert device.found == []
    return device
