"""``sweepctl experiment`` as users run it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from typing import TYPE_CHECKING, Any

import pytest

from support.cli import end, start, sweepctl
from support.root import ROOT
from tools.cli import pools
from tools.experiment import runs, zimablue_run
from tools.experiment.store import LINES, Store
from tools.experiment.trials import Trial

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

SHORT = ("--rooms", "case-1", "--planners", "paper,u-shape", "--max-time", "6", "--seeds", "1")


@pytest.fixture(scope="module")
def two_jobs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make short runs in two processes, and return their folder."""
    out = tmp_path_factory.mktemp("two")
    done = sweepctl("experiment", "compare", *SHORT, "--jobs", "2", "--out", out, "--json")
    assert done.status == 0
    assert done.json["runs"] == 2
    # Without a terminal, every finished run prints a line with the remaining time.
    first, *lines = done.err.strip().splitlines()
    assert first == "0/2 runs done, 2 in parallel"
    assert [line.split()[0] for line in lines] == ["1/2", "2/2"]
    assert all("seed 0: mouth" in line for line in lines)
    return out


def rows(out: Path) -> list[dict[str, Any]]:
    lines = (out / LINES).read_text().splitlines()
    return sorted(map(json.loads, lines), key=lambda row: str(row["key"]))


def test_the_same_to_the_digit_in_one_process_and_in_two(two_jobs: Path, tmp_path: Path) -> None:
    assert sweepctl("experiment", "compare", *SHORT, "--jobs", "1", "--out", tmp_path).status == 0
    assert rows(tmp_path) == rows(two_jobs)
    for name in ("runs.csv", "curves.csv"):
        assert (tmp_path / name).read_bytes() == (two_jobs / name).read_bytes()


def test_finished_runs_are_not_repeated(two_jobs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError("ran again")

    monkeypatch.setattr(pools, "ProcessPoolExecutor", never)
    before = (two_jobs / LINES).read_bytes()
    done = sweepctl("experiment", "compare", *SHORT, "--out", two_jobs)
    assert (done.status, done.err) == (0, "")
    assert "Planners" in done.out
    assert (two_jobs / LINES).read_bytes() == before
    page = (two_jobs / "report.html").read_text()
    assert page.count("<svg") == 3
    assert "The worst runs" in (two_jobs / "tables.md").read_text()


def wait_for_a_line(path: Path, process: subprocess.Popen[str]) -> None:
    while not (path.exists() and path.read_text().endswith("\n")):
        assert process.poll() is None
        time.sleep(0.05)


@pytest.mark.realtime
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_sigterm_keep_finished_results(tmp_path: Path, number: signal.Signals) -> None:
    process = start(
        *("experiment", "compare", "--rooms", "case-1", "--planners", "u-shape", "--seeds", "200"),
        *("--max-time", "3", "--jobs", "1", "--out", tmp_path),
        cwd=tmp_path,
    )
    wait_for_a_line(tmp_path / LINES, process)
    done = end(process, number)
    assert done.status == 0
    assert "Traceback" not in done.err
    kept = len(rows(tmp_path))
    assert 0 < kept < 200
    assert f"{kept} of 200 runs done, kept in {tmp_path}; the same command" in done.err
    assert (tmp_path / "report.html").exists()


@pytest.mark.realtime
@pytest.mark.parametrize("first_s", [0.0, 0.05])
@pytest.mark.parametrize("between_s", [0.0, 0.02, 0.1])
def test_two_signals_at_once_end_the_runs_too(
    tmp_path: Path, first_s: float, between_s: float
) -> None:
    """The command ``timeout`` sends such signals, to the process and to its group.

    The last lines show what the second signal interrupted, and the status must match them. If it
    interrupted nothing, the runs end cleanly with status 0. If it interrupted the report of the
    finished runs, the status is 1. If the command was about to exit, the signal kills it like any
    program.
    """
    process = start(
        *("experiment", "compare", "--rooms", "case-1", "--planners", "u-shape", "--seeds", "200"),
        *("--jobs", "2", "--out", tmp_path),
        cwd=tmp_path,
        own_group=True,
    )
    assert process.stderr is not None
    assert process.stderr.readline() == "0/200 runs done, 2 in parallel\n"
    time.sleep(first_s)
    os.killpg(process.pid, signal.SIGINT)
    time.sleep(between_s)
    done = end(process, signal.SIGINT)
    kept = len(rows(tmp_path)) if (tmp_path / LINES).exists() else 0
    printed = done.err.splitlines()
    if printed[-1] == "the same command continues from there":
        kept_in = f"interrupted before the report; completed runs are kept in {tmp_path}"
        assert printed[-2] == kept_in
        assert done.status == 1
        assert kept, "no finished run to report"
    else:
        reported = (
            f"{kept} of 200 runs done, kept in {tmp_path}; the same command continues from there"
        )
        assert printed[-1] == reported
        # Without a pause, the second signal arrives before the workers have ended.
        assert done.status in ({0} if between_s == 0.0 else {0, -signal.SIGINT})


@pytest.mark.realtime
def test_an_interrupt_before_the_report_names_the_folder_of_the_runs(two_jobs: Path) -> None:
    """The runs of this process are finished, and its report takes forever."""
    script = """
        import sys, time
        from tools.experiment import output
        from tools.cli.main import run
        def for_ever(*_):
            print("writing", file=sys.stderr, flush=True)
            time.sleep(1000)
        output.write_results = for_ever
        run(sys.argv[1:])
    """
    process = subprocess.Popen(
        [
            *(sys.executable, "-c", textwrap.dedent(script)),
            *("experiment", "compare", *SHORT, "--out", str(two_jobs)),
        ],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    assert process.stderr.readline() == "writing\n"
    done = end(process, signal.SIGINT)
    assert done.status == 1
    assert done.err.splitlines() == [
        f"interrupted before the report; completed runs are kept in {two_jobs}",
        "the same command continues from there",
    ]


def test_a_failed_run_is_named_and_the_others_continue(tmp_path: Path) -> None:
    good = Trial("case-1", "u-shape", "none", 0, 1.0)
    bad = Trial("case-1", "no-such-planner", "none", 0, 1.0)
    outcome = runs.run_all(Store(tmp_path, "1"), [bad, good], 1)
    assert not outcome.interrupted
    assert len(outcome.failed) == 1
    assert outcome.failed[0].startswith("case-1 no-such-planner none seed 0 failed: Unknown")
    assert "Traceback" in (tmp_path / runs.ERRORS).read_text()
    assert Store(tmp_path, "1").missing([bad, good]) == [bad]


def test_a_users_mistakes_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("ran all the same")

    monkeypatch.setattr(pools, "ProcessPoolExecutor", never)
    for arguments, text in (
        (("compare", "--rooms", "nowhere"), "no room 'nowhere'"),
        (("compare", "--planners", "x"), "'x' is not one of recovery"),
        (("compare", "--rooms", ","), "no room: give --rooms or --generated"),
        (("limits", "--zimablue"), "--zimablue needs compare"),
        (("paper", "--zimablue"), "--zimablue needs compare"),
        (("compare", "--rooms", "layout:moat"), "no layout 'moat': give one of wall-obstacle,"),
        (("paper", "--rooms", "case-1"), "--rooms: not for paper, which has its own rooms"),
        (("paper", "--planners", "recovery"), "--planners: not for paper"),
        (("paper", "--generated", "0"), "--generated: not for paper"),
        (("--noise", "typical", "--seeds", "3"), "--noise, --seeds: not for paper"),
    ):
        done = sweepctl("experiment", *arguments, "--out", tmp_path)
        assert done.status == 2
        assert text in done.line
    monkeypatch.setattr(zimablue_run, "find_spec", lambda _: None)
    done = sweepctl("experiment", "compare", *SHORT, "--zimablue", "--out", tmp_path)
    assert done.status == 1
    assert "pip install 'sweepctl[compare]'" in done.line
    assert not (tmp_path / LINES).exists()


# ---- versions and constants ------------------------------------------------------------------


def test_two_versions_are_compared_run_by_run(two_jobs: Path, tmp_path: Path) -> None:
    done = sweepctl("experiment", "compare", *SHORT, "--out", tmp_path, "--against", two_jobs)
    assert done.status == 0
    assert "run by run" in done.out
    assert "Pairs with the largest loss" in done.out
    assert "<h2" in (tmp_path / "report.html").read_text()
    assert "Run by run" in (tmp_path / "report.html").read_text()


def test_constants_are_screened_against_their_defaults(tmp_path: Path) -> None:
    grid = ("--rooms", "case-1", "--max-time", "6", "--seeds", "1", "--factors", "2")
    done = sweepctl(
        *("experiment", "sensitivity", *grid, "--out", tmp_path, "--json"),
        *("--constants", "planner.max_attempts,follow.lookahead_m"),
    )
    assert done.status == 0
    assert done.json["runs"] == 3
    table = done.json["tables"]["Sensitivity to the tuned constants"]
    assert {line["constant"] for line in table} == {"planner.max_attempts", "follow.lookahead_m"}
    assert {line["value"] for line in table} == {"4", "0.22"}


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("limits", "--against", "."), "--against needs compare"),
        (("compare", "--constants", "planner.max_attempts"), "--constants needs sensitivity"),
        (("compare", "--factors", "2"), "--factors needs sensitivity"),
        (("sensitivity", "--planners", "paper"), "sensitivity runs recovery"),
        (
            ("sensitivity", "--constants", "planner.max_attempt"),
            "did you mean planner.max_attempts?",
        ),
        (
            ("sensitivity", "--constants", "xyz"),
            "xyz: no such key; known are bearing, braking, ",
        ),
        (("sensitivity", "--factors", "0.7,x"), "'0.7,x' is not a list of factors"),
        (("sensitivity", "--factors", "0"), "'0' is not a list of factors"),
    ],
)
def test_options_of_another_experiment_are_rejected(
    arguments: tuple[str, ...], part: str, tmp_path: Path
) -> None:
    done = sweepctl("experiment", *arguments, "--out", tmp_path / "out")
    assert done.status == 2
    assert part in done.err
