"""The command ``sweepctl diff``, which compares two runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from support.cli import case_1, short_runs, sweepctl

if TYPE_CHECKING:
    from pathlib import Path


pytestmark = pytest.mark.slow


def test_two_runs_side_by_side(tmp_path_factory: pytest.TempPathFactory) -> None:
    first, _, other = short_runs(tmp_path_factory)
    done = sweepctl("diff", first.log, other.log, "--json")
    assert done.status == 0, done.err
    a, b = done.json["a"]["figures"], done.json["b"]["figures"]
    for figures, run in ((a, first), (b, other)):
        reported = run.done.json
        assert figures["path_m"] == reported["path_m"]
        assert figures["coverage.mouth_sweepable"] == reported["coverage"]["mouth_sweepable"]
        assert figures["pose_error_m.end"] == reported["pose_error_m"]["end"]
    delta = done.json["difference"]
    assert delta["path_m"] == round(b["path_m"] - a["path_m"], 6) != 0
    assert delta["t99_s"] is None
    assert (done.json["a"]["outcome"], done.json["b"]["outcome"]) == ("timeout", "timeout")
    people = sweepctl("diff", first.log, other.log)
    assert "coverage mouth sweepable" in people.out
    assert f"{a['path_m']:.2f}" in people.out
    points = 100 * (b["coverage.mouth_sweepable"] - a["coverage.mouth_sweepable"])
    assert f"{points:+.2f} points" in people.out


def test_the_same_run_twice_differs_in_nothing(tmp_path_factory: pytest.TempPathFactory) -> None:
    first, again, _ = short_runs(tmp_path_factory)
    done = sweepctl("diff", first.log, again.log, "--json")
    assert {v for v in done.json["difference"].values() if v is not None} == {0.0}


def test_a_difference_outside_its_limits_is_exit_status_1(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    first, _, other = short_runs(tmp_path_factory)
    change = sweepctl("diff", first.log, other.log, "--json").json["difference"]["path_m"]
    within = sweepctl(
        "diff",
        first.log,
        other.log,
        "--min",
        f"path_m={change - 0.1}",
        "--max",
        f"path_m={change + 0.1}",
    )
    assert within.status == 0, within.err
    below = sweepctl("diff", first.log, other.log, "--min", f"path_m={change + 0.1}")
    assert below.status == 1
    assert f"path_m: the difference {change:+g} is below" in below.err
    above = sweepctl("diff", first.log, other.log, "--max", f"path_m={change - 0.1}", "--json")
    assert above.status == 1
    assert above.json["violations"] == [
        f"path_m: the difference {change:+g} is above {change - 0.1:+g}"
    ]
    missing = sweepctl("diff", first.log, other.log, "--max", "t99_s=0")
    assert missing.status == 1
    assert "t99_s: one of the runs does not have it" in missing.err


@pytest.mark.parametrize(
    ("limit", "reason"),
    [
        ("path=1", "No metric 'path'"),
        ("path_m", "METRIC=DIFFERENCE"),
        ("path_m=nan", "METRIC=DIFFERENCE"),
    ],
)
def test_a_limit_that_is_none_is_a_usage_error(
    limit: str, reason: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    first, _, other = short_runs(tmp_path_factory)
    done = sweepctl("diff", first.log, other.log, "--min", limit)
    assert done.status == 2
    assert reason in done.line


def test_pages_and_pictures(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    first, other = short_runs(tmp_path_factory)[0], case_1(tmp_path_factory)
    html, png = tmp_path / "both.html", tmp_path / "both.png"
    assert sweepctl("diff", first.log, other.log, "--out", html).status == 0
    page = html.read_text()
    assert page.count("<svg") == 2
    assert "B minus A" in page
    assert "src=" not in page
    assert sweepctl("diff", first.log, other.log, "--out", png, "--json").json["out"] == str(png)
    assert png.read_bytes().startswith(b"\x89PNG")
    again = sweepctl("diff", first.log, other.log, "--out", png)
    assert again.status == 1
    assert "--force" in again.line
    missing = sweepctl("diff", first.log, tmp_path / "none.mcap")
    assert missing.status == 1
    assert "none.mcap" in missing.line
