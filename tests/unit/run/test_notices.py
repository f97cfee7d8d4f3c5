"""Notices: events for other programs, derived from the records of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from bridge.run.ending import Ending
from bridge.run.notices import Notice, NoticeKind, NoticeSink
from bridge.session.event_kinds import EventKind
from bridge.session.records import DeviceMessage, EventRecord, Severity
from bridge.supervise.settings import BatteryRule
from protocol.messages.device import Power, Status
from protocol.messages.values import StopCause
from protocol.schema.catalogue import CATALOGUE

if TYPE_CHECKING:
    from bridge.session.records import Record
    from protocol.schema.message import Message

SECOND_NS = 1_000_000_000


class Watched:
    """A sink with the notices that it has emitted."""

    def __init__(self) -> None:
        self.notices: list[Notice] = []
        self.sink = NoticeSink(NullSink(), RobotModel(), BatteryRule(), self.notices.append)

    def take(self, *records: Record) -> list[NoticeKind]:
        before = len(self.notices)
        for record in records:
            self.sink.write(record)
        return [notice.kind for notice in self.notices[before:]]


def message(at_s: float, content: Message) -> DeviceMessage:
    name = CATALOGUE.spec(type(content)).name
    return DeviceMessage(round(at_s * SECOND_NS), None, None, 1, 0, 0, name, content)


def status(at_s: float, cause: StopCause) -> DeviceMessage:
    values = {"stop_cause": int(cause)}
    names = [field.name for field in CATALOGUE.spec(Status).fields]
    return message(at_s, Status(*(values.get(name, 0) for name in names)))


def power(at_s: float, battery_v: float) -> DeviceMessage:
    fields = CATALOGUE.spec(Power).fields
    (battery,) = [field for field in fields if field.name == "battery"]
    values = {"battery": round((battery_v - battery.si_offset) / battery.si_gain)}
    return message(at_s, Power(*(values.get(field.name, 0) for field in fields)))


def session(at_s: float, kind: EventKind) -> EventRecord:
    return EventRecord(round(at_s * SECOND_NS), Severity.WARNING, "session", kind, "why", {})


def test_a_new_stop_of_the_device_is_noticed_with_its_cause() -> None:
    run = Watched()
    assert run.take(status(1.0, StopCause.NONE), status(1.1, StopCause.NONE)) == []
    assert run.take(status(1.2, StopCause.HARDWARE)) == [NoticeKind.STOPPED_FOR_SAFETY]
    assert run.take(status(1.3, StopCause.HARDWARE)) == []
    assert (run.notices[0].cause, run.notices[0].time_ns) == ("hardware", round(1.2 * SECOND_NS))


def test_an_older_stop_and_an_orderly_end_are_not_noticed() -> None:
    run = Watched()
    assert run.take(status(1.0, StopCause.OPERATOR), status(1.1, StopCause.OPERATOR)) == []
    assert run.take(status(1.2, StopCause.NONE), status(1.3, StopCause.SESSION_END)) == []
    assert run.take(status(1.4, StopCause.LINK)) == [NoticeKind.STOPPED_FOR_SAFETY]


def test_a_low_battery_is_noticed_once_and_a_dip_is_not() -> None:
    run = Watched()
    low_v = BatteryRule().low_v
    steady = [power(1.0 + 0.2 * n, low_v + 1.0) for n in range(50)]
    assert run.take(*steady, power(11.0, low_v - 0.2), power(11.2, low_v + 1.0)) == []
    low = [power(12.0 + 0.2 * n, low_v - 0.5) for n in range(200)]
    assert run.take(*low) == [NoticeKind.BATTERY_LOW]
    assert run.notices[0].battery_v is not None
    assert abs(run.notices[0].battery_v - (low_v - 0.5)) < 0.01


def test_a_loss_is_noticed_once_until_the_device_is_back() -> None:
    run = Watched()
    lost, negotiating, ready = EventKind.LOST, EventKind.NEGOTIATING, EventKind.READY
    assert run.take(session(1.0, lost)) == [NoticeKind.DEVICE_LOST]
    assert run.take(session(2.0, negotiating), session(3.0, lost)) == []
    assert run.take(session(4.0, ready), session(5.0, lost)) == [NoticeKind.DEVICE_LOST]


def test_only_the_session_loses_a_device() -> None:
    record = EventRecord(1, Severity.WARNING, "planner", EventKind.LOST, "lost its way", {})
    assert Watched().take(record) == []


def test_a_run_that_ends_for_safety_is_noticed_before_it_is_finished() -> None:
    run = Watched()
    run.take(status(1.0, StopCause.NONE))
    run.sink.finish(Ending("stopped", "tilted", 5, StopCause.SUPERVISE), 5, {"outcome": "stopped"})
    kinds = [notice.kind for notice in run.notices]
    assert kinds == [NoticeKind.STOPPED_FOR_SAFETY, NoticeKind.FINISHED]
    assert run.notices[0].cause == "supervise"
    last = run.notices[1].to_dict()
    assert (last["outcome"], last["exit_status"], last["text"]) == ("stopped", 5, "tilted")


def test_a_stop_that_was_noticed_is_not_repeated_at_the_end() -> None:
    run = Watched()
    run.take(status(1.0, StopCause.NONE), status(1.1, StopCause.SUPERVISE))
    run.sink.finish(Ending("stopped", "tilted", 5, StopCause.SUPERVISE), 5, {"outcome": "stopped"})
    kinds = [notice.kind for notice in run.notices]
    assert kinds == [NoticeKind.STOPPED_FOR_SAFETY, NoticeKind.FINISHED]
