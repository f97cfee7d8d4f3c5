"""The end of a robot's process in a fleet."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, ClassVar

import pytest

from support.waiting import until
from tools.fleet.fleet import Fleet
from tools.fleet.member import Member, Target

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.realtime


def test_the_end_has_the_last_error_even_if_its_reader_is_slow(tmp_path: Path) -> None:
    lines: list[str] = []

    def slow(label: str, line: str, *, is_error: bool) -> None:
        assert (label, is_error) == ("kitchen", True)
        time.sleep(0.3)
        lines.append(line)

    port = str(tmp_path / "nothing")
    member = Member(Target("kitchen", port, port, None, {}, tmp_path / "run.mcap"), [], slow)
    until(lambda: member.ended is not None)
    assert member.ended is not None
    assert (member.ended.exit_status, member.ended.outcome) == (3, "fault")
    assert member.ended.reason == member.last_error == lines[0]
    assert "does not exist" in lines[0]


class Started:
    """A member that is only started and ended; the second one cannot start."""

    made: ClassVar[list[Started]] = []

    def __init__(self, target: Target, arguments: object, on_line: object) -> None:
        del target, arguments, on_line
        if self.made:
            raise OSError("no more processes")
        self.ended = False
        self.made.append(self)

    def end(self) -> None:
        self.ended = True


def test_the_first_process_is_ended_if_the_next_cannot_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tools.fleet.fleet.Member", Started)
    targets = [Target(n, n, n, None, {}, tmp_path / f"{n}.mcap") for n in ("one", "two")]
    fleet = Fleet(targets, [])
    with pytest.raises(OSError, match="no more processes"):
        fleet.start()
    assert [member.ended for member in Started.made] == [True]


def test_an_end_before_the_start_starts_nothing(tmp_path: Path) -> None:
    fleet = Fleet([Target("one", "one", "one", None, {}, tmp_path / "one.mcap")], [])
    fleet.end()
    fleet.start()
    assert fleet.members == []
