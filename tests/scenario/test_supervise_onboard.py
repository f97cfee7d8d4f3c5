"""The device plans; the host starts, supervises and ends the plan, in virtual time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.errors import Remedy
from bridge.floor_plan.floor_plan import parse_floorplan
from bridge.motion.robot_model import RobotModel
from bridge.run.ending import Ending
from bridge.run.host import Host
from bridge.run.mission import Phase
from bridge.run.onboard_mission import OnboardMission
from bridge.run.options import HostOptions
from bridge.session.records import CommandRecord, EventRecord, PlannerRecord
from bridge.session.states import State
from bridge.supervise import SuperviseSettings, Supervisor, parse_rule
from protocol.messages.host import VelocitySetpoint
from protocol.messages.values import Mode, NackReason, OnboardPlanner, StopCause
from sim_device.device.modes import Event
from sim_device.sweeper import VirtualSweeper
from support.ends import Collector, Ends, HostEnd
from support.missions import stop_confirmed

if TYPE_CHECKING:
    from bridge.supervise import Reaction

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("target")]

SMALL = parse_floorplan('{"walls": [[0,0],[1.6,0],[1.6,1.2],[0,1.2]], "start": [0.3,0.3,0]}')


def started(
    *, planner: OnboardPlanner = OnboardPlanner.PAPER, clear_stop: bool = False, rule: str = ""
) -> tuple[Ends, Host, Collector]:
    model, sink = RobotModel(), Collector()
    mission = OnboardMission(planner, clear_stop=clear_stop)
    host = Host(model, sink, HostOptions(0, "onboard", SMALL.start), mission, lambda: 0xB0A7)
    settings = SuperviseSettings()
    host.supervise(Supervisor(model, parse_rule(settings, rule) if rule else settings))
    device = VirtualSweeper(SMALL, model, seed=1, noise="none")
    return Ends(HostEnd(host), device), host, sink


def ending(host: Host) -> Ending:
    assert host.mission.ending is not None
    return host.mission.ending


def test_a_plan_is_started_followed_and_seen_to_end() -> None:
    ends, host, sink = started()
    assert ends.run(300.0, lambda: host.mission.done)
    assert ending(host).outcome == "complete"
    assert ending(host).exit_status == 0
    assert ends.device.firmware.latch.cause is StopCause.SESSION_END
    assert not [s for s in ends.sent if isinstance(s.message, VelocitySetpoint)]
    assert not sink.of(CommandRecord), "the host commands no velocity"
    phases = [r.state.state for r in sink.of(PlannerRecord)]
    assert {"lane", "turn", "finished"} <= set(phases)
    assert host.path_m > 2.0
    assert abs(host.path_m - ends.device.truth.path_m) < 0.05 * host.path_m
    assert not [e for e in sink.of(EventRecord) if e.source == "supervise"], "no false alarm"


def moving() -> tuple[Ends, Host, Collector]:
    ends, host, sink = started()
    assert ends.run(8.0, lambda: ends.moving and host.mission.phase is Phase.DRIVING)
    ends.run(1.0)
    return ends, host, sink


def test_ctrl_c_ends_it() -> None:
    ends, host, _ = moving()
    host.end(Ending("stopped", "ended by Ctrl-C", 0), ends.host_ns)
    assert ends.run(1.0, lambda: host.mission.done)
    assert stop_confirmed(host.mission)
    ends.run(1.0)
    assert not ends.moving
    assert ends.device.firmware.mode is Mode.IDLE


def test_a_latched_stop_needs_a_person() -> None:
    ends, host, _ = started()
    ends.stop_by_another()
    assert ends.run(3.0, lambda: host.mission.done)
    assert ending(host).exit_status == 5
    assert ending(host).remedy is Remedy.CLEAR_STOP
    ends, host, _ = started(clear_stop=True)
    ends.stop_by_another()
    assert ends.run(8.0, lambda: ends.moving)


def test_a_loss_ends_the_plan_on_the_device_and_the_run() -> None:
    ends, host, _ = moving()
    ends.to_device.cut = ends.to_host.cut = True
    ends.run(1.6)
    assert not ends.moving, "the device has stopped by itself"
    assert ends.device.firmware.latch.cause is StopCause.LINK
    assert host.mission.done, "silence is judged before the session gives up"
    assert "no data from the device" in ending(host).reason
    assert ending(host).exit_status == 3, "nobody has confirmed the stop"


def test_a_loss_without_a_decision_ends_the_run_at_the_reconnection() -> None:
    ends, host, _ = started(rule="silence.reaction=off")
    assert ends.run(8.0, lambda: ends.moving and host.mission.phase is Phase.DRIVING)
    ends.to_device.cut = ends.to_host.cut = True
    ends.run(1.6)
    ends.to_device.cut = ends.to_host.cut = False
    assert ends.run(5.0, lambda: host.mission.done)
    assert "lost and is back" in ending(host).reason
    assert ending(host).exit_status == 5
    assert not ends.moving


@pytest.mark.python_only("aborts the plan from inside")
def test_a_plan_that_is_aborted_by_others_ends_the_run() -> None:
    ends, host, _ = moving()
    ends.device.firmware.control.fire(Event.ABORT)
    assert ends.run(2.0, lambda: host.mission.done)
    assert "aborted" in ending(host).reason
    assert ending(host).exit_status == 5


@pytest.mark.python_only("removes the planner from inside")
def test_a_planner_that_the_device_lacks_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim_device.device.control.planner_name", lambda _number: None)
    ends, host, _ = started()
    assert ends.run(4.0, lambda: host.mission.done)
    assert ending(host).exit_status == 4
    assert "unsupported" in ending(host).reason


# ---- reactions --------------------------------------------------------------------------


class Alarm:
    """A supervisor that raises one given alarm."""

    def __init__(self, *reactions: Reaction) -> None:
        self.reactions = list(reactions)
        self.holding = False
        self.factor = 1.0

    def step(self, _supervised: object) -> list[Reaction]:
        reactions, self.reactions = self.reactions, []
        return reactions

    def resume(self, _now_s: float) -> None:
        self.holding = False

    def restart(self) -> None:
        """Do nothing."""


def alarmed(host: Host, level: str) -> Alarm:
    from bridge.supervise import Level, Reaction  # noqa: PLC0415 - to be told apart from the type

    alarm = Alarm(Reaction("tilt", Level[level], "it leans", {"angle": 0.4}))
    assert host.supervision is not None
    host.supervision.supervisor = alarm  # type: ignore[assignment]  # what a watch asks of one
    return alarm


def reported(sink: Collector) -> list[EventRecord]:
    return [e for e in sink.of(EventRecord) if e.source == "supervise"]


def test_reporting_changes_nothing() -> None:
    ends, host, sink = moving()
    alarmed(host, "REPORT")
    ends.run(2.0)
    assert host.mission.phase is Phase.DRIVING
    (event,) = reported(sink)
    assert (event.kind, event.text, event.data) == (
        *("tilt", "it leans"),
        {"angle": 0.4, "level": "report"},
    )


def test_stopping_latches_with_its_cause() -> None:
    ends, host, sink = moving()
    alarmed(host, "STOP")
    assert ends.run(1.0, lambda: host.mission.done)
    assert ends.device.firmware.latch.cause is StopCause.SUPERVISE
    assert ending(host).exit_status == 5
    assert "it leans" in ending(host).reason
    assert reported(sink)[0].data["level"] == "stop"


def test_pausing_holds_the_devices_plan_until_a_person_looked() -> None:
    ends, host, _ = moving()
    alarmed(host, "PAUSE").holding = True
    ends.run(1.5)
    assert not ends.moving
    assert ends.device.firmware.mode is Mode.ONBOARD, "the plan is kept"
    ends.run(5.0)
    assert not ends.moving
    assert host.resume_run(ends.host_ns)
    assert ends.run(2.0, lambda: ends.moving)
    assert not host.resume_run(ends.host_ns), "once"


def test_driving_slowly_sets_the_devices_top_speed_and_gives_it_back() -> None:
    ends, host, _ = moving()
    alarm = alarmed(host, "SLOW")
    before = ends.parameter("max_speed")
    ends.run(0.5)
    alarm.factor = 0.5
    assert ends.run(1.0, lambda: ends.parameter("max_speed") < before)
    assert ends.parameter("max_speed") == pytest.approx(0.5 * host.model.cruise_speed_m_s, rel=1e-6)
    alarm.factor = 1.0
    assert ends.run(1.0, lambda: ends.parameter("max_speed") == before)
    alarm.factor = 0.5
    assert ends.run(1.0, lambda: ends.parameter("max_speed") < before)
    host.end(Ending("stopped", "enough", 0), ends.host_ns)
    assert ends.run(1.0, lambda: host.mission.done)
    ends.run(0.1)
    assert ends.parameter("max_speed") == before, "the end gives it back too"


def slowed() -> tuple[Ends, Host, Collector]:
    """Return a run at half its speed."""
    ends, host, sink = moving()
    alarm = alarmed(host, "SLOW")
    before = ends.parameter("max_speed")
    ends.run(0.5)
    alarm.factor = 0.5
    assert ends.run(1.0, lambda: ends.parameter("max_speed") < before)
    ends.run(0.1)
    return ends, host, sink


def test_full_speed_returns_only_after_the_device_reported_standstill() -> None:
    """The report is lost repeatedly. Until it arrives, the top speed stays low."""
    ends, host, _ = slowed()
    slow = ends.parameter("max_speed")
    ends.to_host.cut = True
    host.end(Ending("stopped", "enough", 0), ends.host_ns)
    assert ends.run(0.5, lambda: ends.device.firmware.latch.cause is StopCause.SESSION_END)
    ends.run(0.3)
    assert ends.parameter("max_speed") == slow
    assert not host.mission.done
    ends.to_host.cut = False
    assert ends.run(0.5, lambda: host.mission.done)
    assert stop_confirmed(host.mission)
    assert ends.parameter("max_speed") > slow
    assert ending(host).reason == "enough"


def check_reported_as_slow(ends: Ends, host: Host, sink: Collector) -> None:
    assert ends.run(1.2, lambda: host.mission.done)
    assert stop_confirmed(host.mission)
    assert ending(host).reason == "enough"
    assert [e.kind for e in reported(sink)][-1] == "slow_left"
    assert "until a reboot" in reported(sink)[-1].text


@pytest.mark.python_only("rejects the parameter from inside")
def test_a_top_speed_whose_return_is_rejected_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    ends, host, sink = slowed()
    host.end(Ending("stopped", "enough", 0), ends.host_ns)
    parameters = ends.device.firmware.parameters
    monkeypatch.setattr(parameters, "set", lambda *_: NackReason.BAD_VALUE)
    check_reported_as_slow(ends, host, sink)


def test_a_top_speed_whose_return_is_lost_is_reported() -> None:
    ends, host, sink = slowed()
    host.end(Ending("stopped", "enough", 0), ends.host_ns)
    assert ends.run(0.5, lambda: ends.device.firmware.latch.cause is StopCause.SESSION_END)
    ends.to_device.cut = True
    check_reported_as_slow(ends, host, sink)


def test_a_device_that_cannot_be_slowed_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bridge.run.supervision._SPEED", "warp_factor")  # which the device lacks
    ends, host, _ = moving()
    alarm = alarmed(host, "SLOW")
    ends.run(1.0)
    assert host.mission.phase is Phase.DRIVING, "nothing is to be slow yet"
    alarm.factor = 0.5
    assert ends.run(0.5, lambda: host.mission.done)
    assert ending(host).exit_status == 5
    assert "cannot be slowed down: it has no parameter warp_factor" in ending(host).reason
    assert ends.device.firmware.latch.cause is StopCause.SUPERVISE


@pytest.mark.python_only("aborts the plan from inside")
def test_a_device_that_does_not_pause_is_stopped() -> None:
    ends, host, _ = moving()
    ends.device.firmware.control.fire(Event.ABORT)  # there is no plan to pause any more
    alarmed(host, "PAUSE").holding = True
    assert ends.run(1.0, lambda: host.mission.done)
    assert ending(host).exit_status == 5
    assert host.session.state is State.READY
