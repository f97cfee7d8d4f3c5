"""``simulate --planner-option``: a valid option changes the run and is logged; others fail."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from mcap.reader import make_reader

from support.cli import decoded, sweepctl

if TYPE_CHECKING:
    from pathlib import Path

    from support.processes import Done


def simulate(log: Path, *arguments: str) -> Done:
    command = ("simulate", "case-1", "--planner", "paper", "--noise", "none", "--json")
    return sweepctl(*command, "--out", log, *arguments)


def test_it_changes_the_run_and_is_on_record(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    done = simulate(log, "--planner-option", "end=blocked_step", "--planner-option", "side=right")
    assert done.json["outcome"] == "complete"
    sides = [event.data_json for _, event in decoded(log, "/events") if event.kind == "start"]
    assert '"right"' in sides[0]
    assert metadata(log)["planner_options"] == "end=blocked_step side=right"


def metadata(log: Path) -> dict[str, str]:
    """Return the run's metadata in the log."""
    with log.open("rb") as file:
        reported = next(make_reader(file).iter_metadata())
    return reported.metadata


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (("--planner-option", "side=up"), "paper: 'side=up': not one of left, right"),
        (("--planner-option", "colour=red"), "paper: no option 'colour'; there are: side, end"),
        (("--planner-option", "side=left", "--supervise"), "cannot be used with --supervise"),
    ],
)
def test_impossible_values_are_rejected_before_a_log_is_made(
    tmp_path: Path, arguments: tuple[str, ...], reported: str
) -> None:
    log = tmp_path / "run.mcap"
    done = simulate(log, *arguments)
    assert done.status == 2
    assert reported in done.err
    assert "Traceback" not in done.err
    assert not log.exists()
