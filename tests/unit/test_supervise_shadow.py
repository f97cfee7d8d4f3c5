"""The shadow of the device's planner: what it finds at a decision, and what it must not find."""

from __future__ import annotations

import pytest

from bridge.motion.geometry import Pose2
from bridge.supervise.settings import DisagreementRule
from bridge.supervise.shadow import Shadow
from protocol.messages import PlannerState
from protocol.values import Contact, PlannerPhase
from support.watching import MODEL, STEP_S, Walk, planner, reading

IDLE, LANE, TURN, STEP = (
    PlannerPhase.IDLE,
    PlannerPhase.LANE,
    PlannerPhase.TURN,
    PlannerPhase.STEP,
)
BACK = PlannerPhase.RECOVERY_BACK
PERIOD = 10
"""Control steps from one planner state to the next: 5 Hz."""
CRUISE_M = 0.2 * STEP_S


class Device:
    """A device that sweeps lanes and tells of them; what it tells can be made wrong."""

    def __init__(self, onboard: str = "paper", rule: DisagreementRule | None = None) -> None:
        self.shadow = Shadow(rule or DisagreementRule(motion_s=1.0), MODEL)
        self.walk = Walk(self.shadow)
        self.onboard = onboard
        self.state = planner(IDLE)
        self.pose = Pose2(0.0, 0.0, 0.0)
        self.contacts = 0
        self.follow_pose = True
        self.found: list[str] = []

    def tell(self, state: PlannerState) -> None:
        self.state = state

    def go(
        self, steps: int, speed_m: float = 0.0, *, rate: float = 0.0, lead_m: float = 0.0
    ) -> None:
        """So many control steps; a new planner state, equal or not, every tenth."""
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
            text, _ = self.shadow.tell()
            if self.walk.held and text not in self.found:
                self.found.append(text)

    def lane(
        self, way_m: float, after: PlannerState, *, before: PlannerState | None = None
    ) -> None:
        """A lane of this way, which the state after it tells of."""
        self.tell(before or planner(LANE, turns=self.state.turn_count, **_kept(self.state)))
        self.go(round(way_m / CRUISE_M), CRUISE_M)
        self.go(30)  # the rest at its end
        self.tell(after)
        self.go(20, rate=0.8)

    @property
    def data(self) -> dict[str, object]:
        return dict(self.shadow.tell()[1])


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


def swept(way_m: float = 1.0, *, turns: int = 1, case: int = 1) -> Device:
    """After a first lane, told as it was, and a side step."""
    device = started()
    mm = round(way_m * 1000)
    device.lane(way_m, planner(TURN, distance=mm, previous=mm, case=case))
    device.tell(planner(STEP, distance=mm, previous=mm, case=case))
    device.go(40, CRUISE_M)
    device.tell(planner(TURN, turns=turns, distance=mm, previous=mm, case=case))
    device.go(40, rate=0.8)
    assert device.found == []
    return device


# ---- D -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("told", "found"), [(1.028, False), (0.972, False), (1.034, True), (0.966, True)]
)
def test_d_is_held_against_the_odometry(told: float, *, found: bool) -> None:
    device = started()
    mm = round(told * 1000)
    device.lane(1.0, planner(TURN, distance=mm, previous=mm, case=1))
    assert bool(device.found) is found
    if found:
        assert device.data["D_m"] == pytest.approx(told)
        assert device.data["odometry_m"] == pytest.approx(1.0, abs=0.005)


def test_d_is_judged_by_the_furthest_not_by_where_it_backed_off_to() -> None:
    device = started()
    device.tell(planner(LANE))
    device.go(250, CRUISE_M)
    device.go(20, -CRUISE_M)
    device.tell(planner(TURN, distance=1000, previous=1000, case=1))
    device.go(10)
    assert device.found == []
    device = started()
    device.tell(planner(LANE))
    device.go(250, CRUISE_M)
    device.go(20, -CRUISE_M)
    device.tell(planner(TURN, distance=920, previous=920, case=1))
    device.go(10)
    assert len(device.found) == 1


def test_each_lane_counts_from_its_own_beginning() -> None:
    device = swept(1.0)
    device.lane(0.8, planner(TURN, turns=1, distance=800, previous=800, case=0))
    assert device.found == []
    device = swept(1.0)
    device.lane(0.8, planner(TURN, turns=1, distance=900, previous=900, case=0))
    assert len(device.found) == 1


def test_the_estimate_may_be_right_where_the_wheels_are_not() -> None:
    """After a bump the wheels turn on: the estimate knows, and D agrees with it."""
    device = started()
    device.tell(planner(LANE))
    device.go(200, CRUISE_M)
    device.follow_pose = False
    device.go(25, CRUISE_M)
    device.follow_pose = True
    device.tell(planner(TURN, distance=800, previous=800, case=1))
    device.go(10)
    assert device.found == []
    device.tell(planner(LANE, distance=800, previous=800, case=1))
    device.go(100, CRUISE_M)
    device.tell(planner(TURN, distance=500, previous=500, case=0))
    device.go(10)
    assert len(device.found) == 1, "now both say 0.4 m"


def test_the_estimates_way_is_along_the_lane() -> None:
    device = started()
    device.pose = Pose2(3.0, 1.0, 0.0)
    device.go(10)
    device.tell(planner(LANE))
    device.follow_pose = False
    device.go(200, CRUISE_M)
    device.pose = Pose2(3.5, 1.7, 0.0)  # 0.86 m away, 0.5 m along
    device.go(10)
    device.tell(planner(TURN, distance=860, previous=860, case=1))
    device.go(10)
    assert len(device.found) == 1
    assert device.data["odometry_m"] == pytest.approx(0.8, abs=0.005)


def test_a_lane_that_slipped_or_pushed_is_in_doubt() -> None:
    device = started()
    device.tell(planner(LANE))
    device.go(250, CRUISE_M, lead_m=0.0012)
    device.go(30)
    device.tell(planner(TURN, distance=900, previous=900, case=1))
    device.go(20)
    assert device.found == [], "a wheel slipped by 6 cm/s for 5 s"
    device = started()
    device.tell(planner(LANE))
    device.go(225, CRUISE_M)
    device.contacts = int(Contact.BUMPER_LEFT)
    device.go(25, CRUISE_M)
    device.contacts = 0
    device.follow_pose = False
    device.tell(planner(TURN, distance=900, previous=900, case=1))
    device.go(10)
    assert device.found == [], "the last 10 cm it pushed against something"
    device = started()
    device.tell(planner(LANE))
    device.contacts = int(Contact.CLIFF)
    device.go(250, CRUISE_M, lead_m=0.0001)
    device.tell(planner(TURN, distance=900, previous=900, case=1))
    device.go(10)
    assert len(device.found) == 1, "a cliff is no push, and 5 mm/s between the rims no slip"


def test_doubt_is_of_one_lane() -> None:
    device = started()
    device.tell(planner(LANE))
    device.go(250, CRUISE_M, lead_m=0.0012)
    device.tell(planner(TURN, distance=900, previous=900, case=1))
    device.go(60)
    device.lane(1.0, planner(TURN, distance=920, previous=920, case=1))
    assert len(device.found) == 1


# ---- what was not seen is not judged -------------------------------------------------------


def test_a_lane_whose_beginning_was_not_seen_is_not_judged_by_its_d() -> None:
    device = Device()
    device.tell(planner(LANE))
    device.go(100, CRUISE_M)
    device.tell(planner(TURN, distance=1500, previous=1500, case=1))
    device.go(20)
    assert device.found == []


def test_after_a_gap_the_devices_figures_are_taken_over() -> None:
    device = swept(1.0)
    device.tell(planner(LANE, turns=1, distance=1000, previous=1000, case=1))
    device.go(50, CRUISE_M)
    held = device.state
    for _ in range(40):  # 0.8 s without a planner state
        device.walk.step(1, planner=held, onboard="paper", pose=device.pose)
    device.tell(planner(TURN, turns=5, distance=1700, previous=1700, case=2))
    device.go(20, rate=0.8)
    assert device.found == []
    device.tell(planner(LANE, turns=5, distance=1700, previous=1700, case=2))
    device.go(425, CRUISE_M)
    device.tell(planner(TURN, turns=5, distance=1700, previous=1700, case=1))
    device.go(20, rate=0.8)
    assert device.found == [], "and the lane after it is judged as ever"


def test_a_gap_within_a_lane_leaves_its_beginning_unknown() -> None:
    device = swept(1.0)
    device.tell(planner(LANE, turns=1, distance=1000, previous=1000, case=1))
    device.go(50, CRUISE_M)
    held = device.state
    for _ in range(40):
        device.walk.step(1, planner=held, onboard="paper", pose=device.pose)
    device.go(50, CRUISE_M)
    device.tell(planner(TURN, turns=1, distance=1010, previous=1010, case=1))
    device.go(20, rate=0.8)
    assert device.found == []


def test_restart_forgets_the_lane() -> None:
    device = swept(1.0)
    device.tell(planner(LANE, turns=1, distance=1000, previous=1000, case=1))
    device.go(50, CRUISE_M)
    device.shadow.restart()
    device.go(50, CRUISE_M)
    device.tell(planner(TURN, turns=1, distance=990, previous=990, case=1))
    device.go(20, rate=0.8)
    assert device.found == []


@pytest.mark.parametrize("onboard", ["recovery", "random", ""])
def test_planners_without_lanes_are_not_judged_by_them(onboard: str) -> None:
    device = started(onboard)
    device.lane(1.0, planner(TURN, distance=300, previous=77, case=3, length=9, turns=7))
    assert device.found == []


def test_u_shape_tells_no_cases() -> None:
    device = started("u-shape")
    device.lane(1.0, planner(TURN, distance=1000, previous=1000, case=0))
    device.lane(0.4, planner(TURN, distance=400, previous=1000, case=0))
    assert device.found == []
    device.lane(0.4, planner(TURN, distance=500, previous=400, case=0))
    assert len(device.found) == 1


def test_the_host_plans_nothing_is_held() -> None:
    walk = Walk(Shadow(DisagreementRule(), MODEL))
    assert not walk.step(100, left_m=0.004, right_m=0.004, planner=planner(IDLE), onboard="")
    assert not walk.step(100, left_m=0.004, right_m=0.004, planner=None, onboard="paper")


# ---- Prev-D, case, Length, T ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("previous", "found"), [(1000, False), (1005, False), (1100, True), (999, True), (0, True)]
)
def test_prev_d_is_this_lane_or_the_one_before(previous: int, *, found: bool) -> None:
    device = swept(1.0)
    device.lane(1.005, planner(TURN, turns=1, distance=1005, previous=previous, case=1))
    assert bool(device.found) is found
    if found:
        assert device.data == {"Prev_D_m": previous / 1000, "D_before_m": 1.0}


@pytest.mark.parametrize(
    ("distance", "case"),
    [
        *[(1000, 1), (1018, 1), (982, 1), (1023, 0), (977, 0), (1300, 0), (700, 0)],
        *[(1322, 3), (1600, 3), (678, 2), (400, 2)],
    ],
)
def test_the_case_follows_from_d_prev_d_and_phi(distance: int, case: int) -> None:
    for told in range(4):
        device = swept(1.0)
        state = planner(TURN, turns=1, distance=distance, previous=distance, case=told, length=8)
        device.lane(distance / 1000, state)
        assert bool(device.found) is (told != case), f"told {told} after {distance}"
        if told != case:
            assert device.data["case"] == told
            assert device.data["expected"] == case
            assert device.data["Prev_D_m"] == 1.0


@pytest.mark.parametrize("distance", [1020, 980, 1021, 979])
def test_at_a_limit_either_case_may_be_right(distance: int) -> None:
    """Both figures are rounded to a millimetre."""
    for told in (0, 1):
        device = swept(1.0)
        device.lane(
            distance / 1000, planner(TURN, turns=1, distance=distance, previous=distance, case=told)
        )
        assert device.found == []


def test_the_first_lane_is_case_1() -> None:
    device = started()
    device.lane(1.0, planner(TURN, distance=1000, previous=1000, case=2))
    assert device.data["expected"] == 1
    device = swept(0.0)
    device.lane(1.0, planner(TURN, turns=1, distance=1000, previous=1000, case=3, length=8))
    assert device.found == [], "a D of 0 is a lane too"


@pytest.mark.parametrize(
    ("turns", "length", "found"),
    [(3, 24, False), (3, 25, True), (3, 23, True), (0, 0, False), (0, 1, True), (40, 255, False)],
)
def test_length_is_w_times_t(turns: int, length: int, *, found: bool) -> None:
    """W is 0.16 m, the wire's step 0.02 m; 255 says 5.1 m or more."""
    device = swept(1.0, turns=turns and 1)
    for now in range(2, turns + 1):
        device.tell(planner(TURN, turns=now, distance=1000, previous=1000, case=1))
        device.go(11, rate=0.8)
    device.lane(
        1.5, planner(BACK, turns=turns, distance=1500, previous=1500, case=3, length=length)
    )
    assert bool(device.found) is found
    if found:
        assert device.data["expected_m"] == pytest.approx(0.16 * turns)
        assert device.data["Length_m"] == pytest.approx(0.02 * length)
        assert device.data["T"] == turns


@pytest.mark.parametrize(
    ("after", "found"), [(1, False), (2, False), (0, False), (3, True), (9, True)]
)
def test_t_grows_by_one_at_a_time(after: int, *, found: bool) -> None:
    device = swept(1.0)
    device.tell(planner(STEP, turns=after, distance=1000, previous=1000, case=1))
    device.go(20, CRUISE_M)
    assert bool(device.found) is found
    if found:
        assert device.data == {"T": after, "T_before": 1}


def test_a_finding_is_held_for_two_seconds_and_told_once() -> None:
    device = started()
    device.lane(1.0, planner(TURN, distance=1100, previous=1100, case=1))
    held = [device.walk.held]
    for steps in (70, 20):
        device.go(steps, rate=0.8)
        held.append(device.walk.held)
    assert held == [True, True, False]
    assert device.shadow.tell() == ("", {})
    assert len(device.found) == 1


# ---- what it says that it does --------------------------------------------------------------


@pytest.mark.parametrize(
    "phase", [IDLE, PlannerPhase.PAUSED, PlannerPhase.FINISHED, PlannerPhase.ABORTED]
)
def test_what_says_that_it_stands_must_stand(phase: PlannerPhase) -> None:
    for speed, rate, found in (
        *((0.0005, 0.0, False), (0.0007, 0.0, True), (-0.0007, 0.0, True)),
        *((0.0, 0.14, False), (0.0, 0.17, True), (0.0, -0.17, True)),
    ):
        device = started("recovery")
        device.tell(planner(phase))
        device.go(20)
        device.go(110, speed, rate=rate)
        assert bool(device.found) is found, (speed, rate)
        if found:
            assert device.data["phase"] == phase.name.lower()
            assert "moves" in device.found[0]


def test_a_claim_is_tested_once_it_is_a_second_old() -> None:
    device = started("recovery")
    device.tell(planner(PlannerPhase.PAUSED))
    device.go(49, CRUISE_M)
    assert device.found == []
    device.go(3, CRUISE_M)
    assert len(device.found) == 1
    assert device.data["for_s"] == pytest.approx(1.0, abs=0.03)
    assert device.data["way_m"] == pytest.approx(0.2, abs=0.01)


def test_a_new_claim_is_not_held_for_what_was_before() -> None:
    device = started("recovery")
    device.tell(planner(LANE))
    device.go(100, CRUISE_M)
    device.tell(planner(PlannerPhase.PAUSED))
    device.go(150)
    assert device.found == []


@pytest.mark.parametrize(("speed", "found"), [(0.0011, False), (0.0013, True), (-0.0013, True)])
def test_a_turn_in_place_makes_no_way(speed: float, *, found: bool) -> None:
    device = started("recovery")
    device.tell(planner(TURN))
    device.go(110, speed, rate=1.0)
    assert bool(device.found) is found
    if found:
        assert "drives" in device.found[0]
        assert device.data["turn_rad"] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("phase", [LANE, STEP])
@pytest.mark.parametrize(("rate", "found"), [(0.55, False), (0.65, True), (-0.65, True)])
def test_a_straight_run_does_not_bend(phase: PlannerPhase, rate: float, *, found: bool) -> None:
    device = started("u-shape")
    device.tell(planner(phase))
    device.go(110, CRUISE_M, rate=rate)
    assert bool(device.found) is found
    if found:
        assert "turns" in device.found[0]
    device = started("recovery")
    device.tell(planner(phase))
    device.go(110, CRUISE_M, rate=rate)
    assert device.found == [], "an outline is a lane too, to the wire"


def test_recovery_phases_may_do_anything() -> None:
    device = started("paper")
    device.tell(planner(PlannerPhase.RECOVERY_RETURN))
    device.go(110, CRUISE_M, rate=1.0)
    assert device.found == []
