"""A campaign continues after an interruption, unless the code has changed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from campaign.kept import Kept, stored_results

if TYPE_CHECKING:
    from pathlib import Path

JOBS = {"first": -1, "second": -2}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return the file of a campaign whose stored result of the first job differs from its work."""
    path = tmp_path / "kept.jsonl"
    assert results(path) == [1, 2]
    path.write_text(path.read_text().replace(" 1]", " 7]"))
    return path


def results(path: Path | None) -> list[int]:
    return list(stored_results(abs, JOBS, Kept(path), 1))


def test_a_stored_job_is_not_run_again(path: Path) -> None:
    assert results(path) == [7, 2]


def test_a_line_cut_short_is_run_again_and_stored_on_a_line_of_its_own(path: Path) -> None:
    path.write_text(path.read_text()[:-3])
    assert Kept(path).of("second") is None
    assert results(path) == [7, 2]
    assert Kept(path).of("second") == 2


def test_results_of_other_code_are_not_used(path: Path) -> None:
    path.write_text(path.read_text().replace('["', '["other'))
    assert results(path) == [1, 2]


def test_without_a_file_nothing_is_stored() -> None:
    assert results(None) == [1, 2]
    assert results(None) == [1, 2]
