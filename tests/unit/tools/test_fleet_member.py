"""The end of a robot's process in a fleet."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest

from support.waiting import until
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
