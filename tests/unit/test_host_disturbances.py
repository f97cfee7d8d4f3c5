"""Bumps, stalls and slips that the estimator finds are on record, each once."""

from __future__ import annotations

from bridge.host_records import HostRecords
from bridge.motion.disturbance import Disturbance, DisturbanceKind
from bridge.telemetry import EventRecord

BUMP = Disturbance(DisturbanceKind.BUMP, 1.0, 0.0312)
SLIP = Disturbance(DisturbanceKind.SLIP_LEFT, 2.0, 0.05)
AGAIN = Disturbance(DisturbanceKind.BUMP, 1.0, 0.0312)
"""Equal to the first, found by another estimator."""


class Kept:
    """A sink in memory."""

    def __init__(self) -> None:
        self.events: list[EventRecord] = []

    def write(self, record: object) -> None:
        """Keep it."""
        assert isinstance(record, EventRecord)
        self.events.append(record)


def kinds_after(*found: tuple[Disturbance, ...]) -> list[list[str]]:
    """What is told at each of some calls."""
    sink = Kept()
    records = HostRecords(sink, 10, "recovery")  # type: ignore[arg-type]
    told = []
    for k, each in enumerate(found):
        before = len(sink.events)
        records.disturbances(each, k)
        told.append([event.kind for event in sink.events[before:]])
    return told


def test_each_is_told_once_oldest_first() -> None:
    told = kinds_after((), (BUMP,), (BUMP,), (BUMP, SLIP), (BUMP, SLIP))
    assert told == [[], ["bump"], [], ["slip_left"], []]
    assert kinds_after((BUMP, SLIP)) == [["bump", "slip_left"]]


def test_of_a_new_estimator_too() -> None:
    assert kinds_after((BUMP,), (), (AGAIN,)) == [["bump"], [], ["bump"]]


def test_with_source_and_size() -> None:
    sink = Kept()
    HostRecords(sink, 10, "recovery").disturbances((BUMP,), 5)  # type: ignore[arg-type]
    (event,) = sink.events
    assert (event.log_ns, event.source, event.data) == (15, "estimator", {"size": 0.031})
