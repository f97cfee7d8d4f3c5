"""Event codes, not event texts, define the beginning and the end of a drive."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from bridge.motion.geometry import Pose2
from bridge.record.log_writer import RunWriter
from bridge.session.event_kinds import EventKind
from bridge.session.records import EventRecord, Severity, TruthRecord
from bridge.session.states import State
from bridge.view.report.run_data import load_run
from support.synthetic_run import EPOCH_NS, run_info

if TYPE_CHECKING:
    from pathlib import Path

STEP_NS = 100_000_000


def coverage_path_m(path: Path, events: dict[int, tuple[str, dict[str, Any]]]) -> float:
    """Return the length of the path in the report's coverage; there are 50 steps of 0.02 m."""
    writer = RunWriter(path, run_info())
    for step in range(50):
        at_ns = EPOCH_NS + step * STEP_NS
        if step in events:
            text, data = events[step]
            event = EventRecord(at_ns, Severity.INFO, "session", EventKind.PHASE, text, data)
            writer.write(event)
        writer.write(TruthRecord(at_ns, Pose2(0.3 + 0.02 * step, 0.3, 0.0)))
    writer.close()
    report = load_run(path).coverage
    assert report is not None
    return report.path_m


def test_the_drive_is_found_by_the_phase_with_any_text(tmp_path: Path) -> None:
    events: dict[int, tuple[str, dict[str, Any]]] = {
        20: ("the robot sets off", {"phase": "driving"}),
        40: ("that is all", {"phase": "ending"}),
    }
    assert coverage_path_m(tmp_path / "new.mcap", events) == pytest.approx(0.4)


def test_logs_of_0_1_have_the_phase_in_words_only(tmp_path: Path) -> None:
    events: dict[int, tuple[str, dict[str, Any]]] = {
        20: ("run is driving", {}),
        40: ("run is ending", {}),
    }
    assert coverage_path_m(tmp_path / "old.mcap", events) == pytest.approx(0.4)


def test_another_programs_events_do_not_concern_the_drive(tmp_path: Path) -> None:
    events: dict[int, tuple[str, dict[str, Any]]] = {20: ("", {}), 40: ("driving on", {"phase": 7})}
    assert coverage_path_m(tmp_path / "other.mcap", events) == pytest.approx(0.98)


@pytest.mark.parametrize("state", State)
def test_every_state_of_a_session_is_a_kind_of_event(state: State) -> None:
    assert EventKind(state.value).name == state.name
