"""Supervision compares the motion with the setpoint after the limits of the device's reflexes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.coverage.runner import PlanRunner
from bridge.motion.observation import Observation, VelocityCommand
from bridge.motion.robot_model import RobotModel
from bridge.run.host import Host
from bridge.run.mission import Mission
from bridge.run.options import HostOptions
from bridge.session.records import CommandRecord, EventRecord
from bridge.supervise import RuleInputs, SuperviseSettings, Supervisor, limited_command
from protocol.messages.values import Contact, Fault
from support.ends import Collector, Ends, HostEnd, Spinning, sweeper
from support.watching import reading, status

if TYPE_CHECKING:
    from bridge.supervise import Reaction

AHEAD = VelocityCommand(0.2, 0.5)
BACK = VelocityCommand(-0.1, 0.5)
LIMITED, CLIFF = int(Fault.LIMITED), int(Contact.CLIFF)
LEFT = int(Contact.BUMPER_LEFT)


@pytest.mark.parametrize(
    ("command", "faults", "contacts", "obeyed_m_s"),
    [
        (AHEAD, 0, CLIFF, 0.2),  # the cliff reflex is off
        (AHEAD, LIMITED, CLIFF, 0.0),
        (AHEAD, LIMITED, CLIFF | LEFT, 0.0),
        (AHEAD, LIMITED, LEFT, 0.05),
        (AHEAD, LIMITED, 0, 0.05),  # the switch has just opened
        (BACK, LIMITED, CLIFF | LEFT, -0.1),
    ],
)
def test_a_reflex_limits_the_speed_ahead_only(
    command: VelocityCommand, faults: int, contacts: int, obeyed_m_s: float
) -> None:
    obeyed = limited_command(command, status(faults), reading(contacts=contacts))
    assert obeyed == VelocityCommand(obeyed_m_s, 0.5)


def test_without_a_status_the_setpoint_stands() -> None:
    assert limited_command(AHEAD, None, None) == AHEAD


class Pushing(PlanRunner):
    """A plan that always drives ahead."""

    def step(self, obs: Observation) -> VelocityCommand:
        super().step(obs)
        return VelocityCommand(0.2, 0.0)


class Spy(Supervisor):
    """A supervisor that stores the inputs of its rules."""

    def __init__(self, model: RobotModel) -> None:
        super().__init__(model, SuperviseSettings())
        self.seen: list[RuleInputs] = []

    def step(self, inputs: RuleInputs) -> list[Reaction]:
        self.seen.append(inputs)
        return super().step(inputs)


def test_rules_see_the_limited_setpoint_and_none_takes_the_limit_for_a_fault() -> None:
    """A bumper switch that is stuck for 3 s limits a robot without an obstacle to 0.05 m/s."""
    model = RobotModel()
    sink = Collector()
    mission = Mission(Pushing(Spinning(model), model))
    host = Host(model, sink, HostOptions(0, "pushing"), mission, lambda: 5)
    spy = Spy(model)
    host.supervise(spy)
    ends = Ends(HostEnd(host), sweeper())
    ends.device.sensors.faults.bumper_stuck_left = True
    assert ends.run(6.0, lambda: ends.moving)
    ends.run(3.0, lambda: False)
    limited = [i for i in spy.seen if i.status is not None and i.status.faults & LIMITED]
    assert len(limited) > 100
    assert {i.command for i in limited if i.command is not None} == {VelocityCommand(0.05, 0.0)}
    assert {record.v_m_s for record in sink.of(CommandRecord)} >= {0.2}
    assert 0.02 < ends.device.truth.v_m_s < 0.06
    kinds = {event.kind for event in sink.of(EventRecord) if event.source == "supervise"}
    assert not kinds & {"stall", "slip", "progress"}
