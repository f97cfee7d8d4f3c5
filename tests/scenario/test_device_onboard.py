"""The device runs the planner itself.

The test starts it with single frames, without a host; the plant gives the truth.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bridge.coverage.registry import PLANNERS
from bridge.coverage.runner import PlanRunner
from bridge.evaluation.metrics import CoverageMeter
from bridge.motion.robot_model import RobotModel
from protocol.messages.device import Encoders, Hello, PlannerState, Status, Sync
from protocol.messages.values import (
    Capability,
    Mode,
    NackReason,
    OnboardPlanner,
    PlannerAction,
    PlannerPhase,
    StopCause,
)
from sim_device.device.onboard import AT_REST_US
from sim_device.sweeper import VirtualSweeper
from support.ends import RAMP_US, REST_M_S, sweeper
from support.wire_host import SESSION, WireHost
from tools.cli.rooms import load_room

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2
    from bridge.motion.observation import Observation, VelocityCommand

pytestmark = pytest.mark.usefixtures("target")

START, PAUSE, RESUME, ABORT = PlannerAction


def phase(host: WireHost[VirtualSweeper]) -> PlannerPhase:
    return PlannerPhase(host.last(PlannerState).phase)


def driving() -> WireHost[VirtualSweeper]:
    """Return a host whose device drives the first lane, in the middle of a wide floor."""
    host = WireHost(sweeper())
    host.start_plan()
    host.run(AT_REST_US / 1e6 + 2.0)
    assert speed(host) > 0.15
    return host


def speed(host: WireHost[VirtualSweeper]) -> float:
    return abs(host.device.truth.v_m_s)


def test_a_whole_clean_of_the_papers_first_room() -> None:
    plan, model = load_room("case-1"), RobotModel()
    host = WireHost(VirtualSweeper(plan, model, seed=1, noise="typical"))
    assert host.hello.capabilities & Capability.ONBOARD_PLANNER
    host.start_plan()
    track: list[tuple[float, float, float, float]] = []
    states: dict[PlannerPhase, int] = {}

    def look() -> None:
        pose = host.device.plant.pose
        track.append((host.now_us / 1e6, *pose))

    host.each_step = look
    assert host.run(600.0, lambda: host.device.firmware.mode is Mode.IDLE)
    ended_us = host.now_us
    host.run(1.0)
    states = {PlannerPhase(m.phase): 1 for m in host.of(PlannerState)}
    assert phase(host) is PlannerPhase.FINISHED
    assert {PlannerPhase.LANE, PlannerPhase.TURN, PlannerPhase.STEP} < set(states)
    assert any(line.startswith("planner paper finished: ") for line in host.lines())
    assert (host.status.mode, host.status.stop_cause) == (Mode.IDLE, StopCause.NONE)
    assert CoverageMeter(plan, model).measure(track).coverage.body_free >= 0.9
    # Reported at 5 Hz all the time, with the paper's variables.
    reported = [at for at, _, m in host.received if isinstance(m, PlannerState) and at <= ended_us]
    assert len(reported) == pytest.approx(5 * ended_us / 1e6, rel=0.02)
    # Along the first lane D is the free path minus the robot's front and the stop range.
    lanes = {m.lane_distance_m for m in host.of(PlannerState)} - {0.0}
    assert max(lanes) == pytest.approx(2.06 - 2 * model.radius_m, abs=0.06)
    assert {m.lane_case for m in host.of(PlannerState)} >= {0, 1, 2}
    # It stays there.
    stands = host.device.plant.pose
    host.run(1.0)
    assert host.device.plant.pose == stands


def test_it_rests_first_and_then_drives_from_its_own_origin() -> None:
    host = WireHost(sweeper())
    host.start_plan()
    host.run(AT_REST_US / 1e6 - 0.2)
    assert host.device.truth.path_m < 1e-6
    assert (phase(host), host.status.mode) == (PlannerPhase.IDLE, Mode.ONBOARD)
    host.run(3.2)
    assert phase(host) is PlannerPhase.LANE
    state = host.last(PlannerState)
    # The robot starts at (10, 10) in the room. The origin of its own frame is this start.
    assert state.target_x_m == pytest.approx(host.device.truth.path_m, abs=0.06)
    assert abs(state.target_y_m) < 0.02
    assert host.status.setpoint_remaining == 0, "nobody's setpoints move it"


def test_after_a_pause_it_continues_along_its_line() -> None:
    host = driving()
    heading = host.device.truth.heading_rad
    assert host.plan(PAUSE) is None
    host.run(RAMP_US / 1e6 + 0.3)
    assert speed(host) < REST_M_S
    assert phase(host) is PlannerPhase.PAUSED
    stands = host.device.plant.pose
    host.run(5.0)
    assert host.device.plant.pose.distance_m(stands) < 1e-3
    assert host.plan(PAUSE) is None, "paused already: nothing to refuse"
    assert host.plan(RESUME) is None
    host.run(2.0)
    assert speed(host) > 0.15
    assert phase(host) is PlannerPhase.LANE
    assert host.device.truth.heading_rad == pytest.approx(heading, abs=0.02)


def test_an_aborted_plan_stops_and_cannot_be_resumed() -> None:
    host = driving()
    assert host.plan(ABORT) is None
    host.run(RAMP_US / 1e6 + 0.3)
    assert speed(host) < REST_M_S
    assert (phase(host), host.status.mode) == (PlannerPhase.ABORTED, Mode.IDLE)
    assert "planner paper aborted" in host.lines()
    assert host.plan(RESUME) is NackReason.OTHER_MODE
    assert host.plan(START) is NackReason.OTHER_MODE, "the mode is to be chosen anew"
    assert host.choose(Mode.ONBOARD) is None
    assert host.plan(START) is None
    host.run(AT_REST_US / 1e6 + 2.0)
    assert speed(host) > 0.15
    assert host.last(PlannerState).target_x_m < 0.5, "another plan, another origin"


@pytest.mark.parametrize("paused", [False, True])
def test_a_stop_ends_the_plan_for_good(paused: bool) -> None:  # noqa: FBT001 - a table
    host = driving()
    if paused:
        assert host.plan(PAUSE) is None
    assert host.stop() is None
    stopped_us = host.now_us
    assert host.run(1.0, lambda: speed(host) < REST_M_S)
    assert host.now_us - stopped_us <= RAMP_US
    host.run(0.5)
    assert (phase(host), host.status.stop_cause) == (PlannerPhase.ABORTED, StopCause.OPERATOR)
    assert host.plan(RESUME) is NackReason.STOP_LATCHED
    assert host.choose(Mode.ONBOARD) is NackReason.STOP_LATCHED
    assert host.clear(StopCause.OPERATOR) is None
    stands = host.device.plant.pose
    host.run(4.0)
    assert host.device.plant.pose.distance_m(stands) < 1e-3, "clearing moves nothing"
    assert host.plan(RESUME) is NackReason.OTHER_MODE


def test_without_its_host_it_stops_within_a_second_and_the_ramp() -> None:
    host = driving()
    host.alive = False
    silent_us = host.now_us
    moving_us = 0

    def look() -> None:
        nonlocal moving_us
        if speed(host) > REST_M_S:
            moving_us = host.now_us

    host.each_step = look
    host.run(4.0)
    assert silent_us + 700_000 < moving_us <= silent_us + 1_020_000 + RAMP_US
    assert host.device.firmware.latch.cause is StopCause.LINK
    host.alive = True
    host.join(SESSION + 1)
    host.run(0.5)
    assert phase(host) is PlannerPhase.ABORTED
    assert host.clear(StopCause.LINK) is None
    stands = host.device.plant.pose
    host.run(3.0)
    assert host.device.plant.pose.distance_m(stands) < 1e-3, "a host that is back restarts nothing"


def test_another_session_stops_it() -> None:
    host = driving()
    host.join(SESSION + 1)
    host.run(1.0)
    assert (speed(host) < REST_M_S, host.status.stop_cause) == (True, StopCause.LINK)


def test_another_mode_ends_the_plan() -> None:
    host = driving()
    assert host.choose(Mode.ONBOARD) is None, "the mode that it is in: the plan goes on"
    host.run(0.5)
    assert phase(host) is PlannerPhase.LANE
    assert host.choose(Mode.VELOCITY) is None
    host.run(1.0)
    assert (speed(host) < REST_M_S, phase(host)) == (True, PlannerPhase.ABORTED)


@pytest.mark.python_only("the core has the paper's planner only")
def test_every_planner_of_the_registry_and_no_other() -> None:
    names = {p: p.name.lower().replace("_", "-") for p in OnboardPlanner}
    for number, name in names.items():
        host = WireHost(sweeper())
        host.join()
        assert host.clear() is None
        assert host.choose(Mode.ONBOARD) is None
        known = name in PLANNERS
        assert host.plan(START, number) is (None if known else NackReason.UNSUPPORTED), name
        host.run(AT_REST_US / 1e6 + 1.5)
        assert (speed(host) > 0.1) is known, name
    assert set(PLANNERS) <= set(names.values())
    host = WireHost(sweeper())
    host.join()
    host.clear()
    host.choose(Mode.ONBOARD)
    assert host.plan(START, 9) is NackReason.UNSUPPORTED
    assert host.plan(PlannerAction(0), 9) is NackReason.UNSUPPORTED


def test_requests_in_a_wrong_state_are_rejected() -> None:
    host = WireHost(sweeper())
    assert host.plan(START) is NackReason.NO_SESSION
    host.join()
    assert host.plan(START) is NackReason.STOP_LATCHED
    assert host.clear() is None
    assert host.plan(START) is NackReason.OTHER_MODE
    assert host.choose(Mode.ONBOARD) is None
    for action in (PAUSE, RESUME):
        assert host.plan(action) is NackReason.OTHER_MODE
    assert host.plan(ABORT) is None, "nothing to abort"
    assert host.plan(START) is None
    assert host.plan(START) is NackReason.OTHER_MODE, "one plan at a time"


@pytest.mark.python_only("the core has the paper's planner only")
def test_the_same_seed_drives_the_same_way() -> None:
    def end(seed: int) -> Pose2:
        host = WireHost(VirtualSweeper(load_room("case-1"), seed=seed, noise="typical"))
        host.start_plan(OnboardPlanner.RANDOM)
        host.run(16.0)
        return host.device.plant.pose

    assert end(3) == end(3)
    assert end(3) != end(4)


@pytest.mark.python_only("the core has the paper's planner only")
def test_the_planner_receives_the_uncertain_floor(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Observation] = []
    step = PlanRunner.step

    def spy(self: PlanRunner, obs: Observation) -> VelocityCommand:
        seen.append(obs)
        return step(self, obs)

    monkeypatch.setattr(PlanRunner, "step", spy)
    host = WireHost(VirtualSweeper(load_room("case-1"), RobotModel(), seed=1, noise="typical"))
    host.start_plan(OnboardPlanner.RECOVERY)
    host.run(45.0)
    assert all(0.0 < obs.gyro_bias_sigma_rad_s < math.radians(0.1) for obs in seen[-100:])
    # nothing yet, and after two walls were found to be orthogonal
    assert seen[0].heading_sigma_rad == 0.0
    assert 0.0 < seen[-1].heading_sigma_rad < math.radians(2.0)


def test_telemetry_does_not_change() -> None:
    host = driving()
    before = {kind: len(host.of(kind)) for kind in (Encoders, Status, Sync, Hello)}
    host.run(2.0)
    assert {k: len(host.of(k)) - n for k, n in before.items()} == {
        Encoders: 100,
        Status: 20,
        Sync: 20,
        Hello: 0,
    }
    assert math.isfinite(host.device.truth.path_m)
