"""The C firmware's planner in the virtual robot: the paper's cases, compared with Python."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from bridge.evaluation.metrics import CoverageMeter
from bridge.floor_plan.floor_plan import parse_floorplan
from bridge.motion.robot_model import RobotModel
from protocol.link import Received
from protocol.messages.device import LogText, PlannerState
from protocol.messages.host import ClearStop, HostHello, PlannerCommand, SetMode, Stop, TimeRequest
from protocol.messages.values import Mode, PlannerAction, PlannerPhase, StopCause
from protocol.schema.message import Direction
from protocol.uart.link import Link
from sim_device.sweeper import VirtualSweeper
from support.core_build import script_board
from support.core_robot import CoreRobot
from support.script_format import Boot

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bridge.floor_plan.floor_plan import FloorPlan
    from protocol.schema.message import Message

pytestmark = pytest.mark.slow

ROOM = {
    "name": "a block in the way",
    "walls": [[0, 0], [1.5, 0], [1.5, 1.6], [0, 1.6]],
    "obstacles": [[[0.75, 0.55], [1.5, 0.55], [1.5, 0.8], [0.75, 0.8]]],
    "start": [0.2, 0.2, 0.0],
}
RUNNING = 5
STEP_S = 0.1
LEAVE: list[Message] = [
    HostHello(0, 7, Boot().boot_id, 1, "test"),
    ClearStop(1, StopCause.SESSION_END),
    SetMode(2, Mode.ONBOARD),
    PlannerCommand(3, PlannerAction.START, 0),
]


@pytest.fixture
def plan() -> FloorPlan:
    return parse_floorplan(json.dumps(ROOM))


@pytest.fixture
def robot(plan: FloorPlan) -> Iterator[CoreRobot]:
    made = CoreRobot(script_board().program, plan, noise="none")
    yield made
    made.close()


def start(robot: CoreRobot) -> None:
    robot.live(STEP_S)
    for message in LEAVE:
        robot.inform(message)
        robot.live(STEP_S)
    assert robot.reported.state == RUNNING


def drive(robot: CoreRobot, seconds: float) -> None:
    """Run while the plan is active; time requests keep the session open."""
    end_us = robot.now_us + round(seconds * 1e6)
    while robot.now_us < end_us and robot.reported.state == RUNNING:
        robot.inform(TimeRequest(0))
        robot.live(0.5)


ALIKE = {
    "lane: D = Prev-D: the lanes are equally long",
    "lane: D and Prev-D differ, by less than Φ: none of the cases",
}
"""Pairs of decisions that millimetres of the estimate distinguish, without further effect."""


def decisions(received: list[Message]) -> list[str]:
    """Return the planner's decisions, without "planner paper ..." and the session's lines."""
    kinds = {
        "start",
        "lane",
        "blocked",
        "recovery-begin",
        "recovery-lane",
        "recovery-end",
        "finish",
    }
    lines = [m.line for m in received if isinstance(m, LogText)]
    reported = [line for line in lines if line.split(":")[0] in kinds]
    return ["lane: D is about Prev-D" if line in ALIKE else line for line in reported]


def distances_m(received: list[Message]) -> list[float]:
    """Return D after each change, as reported at 5 Hz."""
    found: list[float] = []
    for state in (m for m in received if isinstance(m, PlannerState)):
        if state.lane_distance and (not found or found[-1] != state.lane_distance / 1000):
            found.append(state.lane_distance / 1000)
    return found


def python_model(plan: FloorPlan) -> list[Message]:
    """Run the same plan on the Python firmware in the same room; return its messages."""
    link = Link(Direction.HOST)
    device = VirtualSweeper(plan, noise="none", boot_id=Boot().boot_id)
    received: list[Message] = []
    leave = [*LEAVE]
    end_us, now_us = 400_000_000, 0
    while now_us < end_us:
        now_us += 100_000
        message: Message = leave.pop(0) if leave else TimeRequest(0)
        link.send(message, now_us, node=1)
        events = link.receive(device.step(link.data_to_send(), now_us))
        received += [e.message for e in events if isinstance(e, Received)]
        reported = [m for m in received[-20:] if isinstance(m, PlannerState)]
        if any(m.phase == PlannerPhase.FINISHED for m in reported):
            end_us = min(end_us, now_us + 1_000_000)  # its reason may be a line later
    return received


def test_it_plans_as_the_python_firmware_does(robot: CoreRobot, plan: FloorPlan) -> None:
    """Both make the same decisions in the same order, and have equal lanes."""
    start(robot)
    track = CoverageMeter(plan, RobotModel(), 0.01).track()
    while robot.reported.state == RUNNING and robot.now_us < 300_000_000:
        robot.inform(TimeRequest(0))
        robot.live(STEP_S)
        track.add(robot.now_us * 1e-6, *robot.plant.pose)
    robot.live(1.5)
    model = python_model(plan)
    assert decisions(robot.received) == decisions(model)
    assert "recovery-begin" in {line.split(":")[0] for line in decisions(model)}
    assert distances_m(robot.received) == pytest.approx(distances_m(model), abs=0.03)
    last = [m for m in robot.received if isinstance(m, PlannerState)][-1]
    assert last.phase == PlannerPhase.FINISHED
    assert track.report().coverage.mouth_sweepable > 0.8


def test_a_pause_keeps_the_leg_and_a_stop_ends_the_plan(robot: CoreRobot) -> None:
    start(robot)
    drive(robot, 5.0)
    assert robot.plant.truth.v_m_s > 0.1
    robot.inform(PlannerCommand(4, PlannerAction.PAUSE, 0))
    robot.live(0.6)
    held = robot.plant.pose
    robot.live(0.3)
    assert robot.plant.pose.distance_m(held) < 1e-3
    robot.inform(PlannerCommand(5, PlannerAction.RESUME, 0))
    robot.live(0.8)
    assert robot.plant.truth.v_m_s > 0.1
    assert robot.plant.pose.theta_rad == pytest.approx(held.theta_rad, abs=0.02)
    robot.inform(Stop(6, StopCause.OPERATOR))
    robot.live(0.6)
    assert robot.plant.truth.v_m_s == 0.0
    assert robot.reported.stop_cause == StopCause.OPERATOR


def test_without_a_host_the_plan_ends(robot: CoreRobot) -> None:
    start(robot)
    drive(robot, 4.0)
    robot.live(1.6)
    assert robot.reported.stop_cause == StopCause.LINK
    assert robot.plant.truth.v_m_s == 0.0
