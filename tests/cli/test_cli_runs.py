"""``sweepctl runs`` as users run it: its documentation page, its output and its errors."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from support.cli import sweepctl
from support.root import ROOT
from support.small_logs import write_log
from tools.cli.main import run
from tools.dev.run_columns import PATH, with_columns

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

PAGE = PATH.read_text("utf-8")
LINES = [
    shlex.split(line)[1:]
    for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    for line in block.splitlines()
]


@pytest.fixture(name="runs")
def folder_of_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "runs"
    folder.mkdir()
    for number, planner in enumerate(("paper", "recovery", "paper")):
        name = f"run-{number}.mcap"
        coverage = 0.8 + number / 20
        write_log(folder / name, seed=number, planner=planner, coverage=coverage, at_s=number)
    return folder


def test_the_page_lists_the_present_columns() -> None:
    assert with_columns(PAGE) == PAGE, "run `python -m tools.dev.run_columns`"


def test_each_command_of_the_page_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert len(LINES) > 10
    for words in LINES:
        done = sweepctl(*words)
        # The simulated runs of the page end at their time limit.
        assert done.status == (1 if words[0] == "simulate" else 0), (words, done.err)
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {"runs", "planners.html", "missed.html", "newest.html"}
    assert "case-1: 2 runs" in (tmp_path / "missed.html").read_text()
    assert "By planner" in (tmp_path / "planners.html").read_text()


def test_the_list_has_a_line_for_each_run_and_the_newest_is_last(runs: Path) -> None:
    lines = sweepctl("runs").out.splitlines()
    assert lines[0].split() == [
        *("date", "room", "planner", "seed", "outcome", "swept", "time", "path", "coll."),
        *("events", "lost", "tags", "log"),
    ]
    assert [line.split()[-1] for line in lines[1:]] == [f"runs/run-{n}.mcap" for n in range(3)]
    assert lines[-1].split()[:6] == [
        "2023-11-14",
        "22:13:22",
        "synthetic",
        "paper",
        "2",
        "complete",
    ]
    assert sweepctl("runs", runs, "--sort", "-seed").out.splitlines()[1].endswith("run-2.mcap")


def test_json_has_every_column_and_the_files_that_cannot_be_read(runs: Path) -> None:
    (runs / "broken.mcap").write_text("no log")
    done = sweepctl("runs", "--json", "--where", "seed >= 1")
    found = json.loads(done.out)
    columns = [
        column["name"]
        for column in json.loads(sweepctl("runs", "columns", "--json").out)["columns"]
    ]
    assert [list(run) for run in found["runs"]] == [columns, columns]
    assert found["unreadable"] == [{"log": "runs/broken.mcap", "problem": "it is not an MCAP file"}]
    assert (done.status, done.err) == (0, "")
    assert "runs/broken.mcap: cannot be read: it is not an MCAP file" in sweepctl("runs").err


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--where", "covrage > 1"), "no column 'covrage'; did you mean coverage?"),
        (("--sort", "covrage"), "no column 'covrage' to sort by; did you mean coverage?"),
        (("nowhere",), "'nowhere' does not exist"),
        (("tag", "latest~9", "x"), "no run latest~9 in runs: it has 3 runs"),
        (("tag", "latest", "two words"), "'two words' is no tag"),
        (("tag", "latest", "--remove"), "--remove needs the tags to remove"),
        (("compare", "--by", "planer"), "no column 'planer'; did you mean planner?"),
        (("compare", "--out", "x.pdf"), "the format is .html or .htm or .png, not .pdf"),
        (("heatmap", "--out", "x.html", "--where", "0"), "no selected run has a known room"),
    ],
)
def test_an_error_is_one_line(runs: Path, words: tuple[str, ...], text: str) -> None:
    done = sweepctl("runs", *words)
    assert done.status == 2
    assert text in done.line
    assert (runs / "run-0.mcap").exists()


def test_a_log_that_is_not_there_is_named(runs: Path) -> None:
    del runs
    for words in (("tag", "runs/none.mcap", "x"), ("note", "runs/none.mcap", "x")):
        done = sweepctl("runs", *words)
        assert (done.status, "runs/none.mcap: No such file" in done.line) == (1, True)


def test_without_the_default_folder_it_asks_for_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = sweepctl("runs")
    assert (done.status, done.line) == (
        2,
        "sweepctl: there is no folder runs: give the folder of the logs",
    )


def test_tags_and_notes_are_shown(runs: Path) -> None:
    assert sweepctl("runs", "tag", "latest", "b", "a").out == "runs/run-2.mcap: a b\n"
    sweepctl("runs", "note", runs / "run-2.mcap", "a note")
    assert sweepctl("runs", "tag", "runs/latest").out == "runs/run-2.mcap: a b\n  a note\n"
    done = json.loads(sweepctl("runs", "tag", "latest", "a", "--remove", "--json").out)
    assert done == {"log": "runs/run-2.mcap", "tags": ["b"], "note": "a note"}


def test_compare_shows_medians_by_group(runs: Path) -> None:
    lines = sweepctl("runs", "compare", runs).out.splitlines()
    assert [line.split()[:4] for line in lines[1:]] == [
        ["paper", "2", "2", "85.00"],
        ["recovery", "1", "1", "85.00"],
    ]
    found = json.loads(sweepctl("runs", "compare", "--by", "seed", "--json").out)
    assert [(group["name"], group["figures"]["coverage"]["mean"]) for group in found["groups"]] == [
        ("0", 0.8),
        ("1", 0.85),
        ("2", 0.9),
    ]
    assert sweepctl("runs", "compare", "--out", "c.png").status == 0
    again = sweepctl("runs", "compare", "--out", "c.png")
    assert (again.status, "c.png exists" in again.line) == (1, True)


def test_the_heat_map_counts_unswept_floor(runs: Path, tmp_path: Path) -> None:
    (runs / "broken.mcap").write_text("no log")
    found = json.loads(sweepctl("runs", "heatmap", "--out", "m.png", "--json").out)
    (room,) = found["rooms"]
    assert (room["room"], room["runs"]) == ("synthetic", 3)
    # The synthetic runs are equal, so all runs miss the same floor.
    assert room["always_missed_cm2"] == room["often_missed_cm2"] > 0
    assert all(piece["missed_share"] == 1.0 for piece in room["pieces"])
    assert (tmp_path / "m.png").read_bytes().startswith(b"\x89PNG")
    assert sweepctl("runs", "heatmap", "--out", "m.html").status == 0
    assert "synthetic: missed by at least half" in (tmp_path / "m.html").read_text()


def test_latest_is_read_by_every_command_that_reads_a_log(runs: Path) -> None:
    newest = "runs/run-2.mcap"
    assert json.loads(sweepctl("info", "latest", "--json").out)["path"] == newest
    assert json.loads(sweepctl("doctor", "latest", "--json").out)["target"] == newest
    found = json.loads(sweepctl("diff", "latest~2", "latest", "--json").out)
    assert (found["a"]["log"], found["b"]["log"]) == ("runs/run-0.mcap", newest)
    assert sweepctl("report", "latest", "--out", "r.html").status == 0
    assert sweepctl("export", "latest", "--out", "tables").status == 0
    assert sweepctl("recover", "latest", "--out", "whole.mcap").status == 0
    assert sweepctl("view", "latest", "--png", "v.png").status == 0
    assert "messages are equal" in sweepctl("replay", "latest", "--check").line
    assert "no run latest~5" in sweepctl("info", "latest~5").line
    assert runs.is_dir()


def test_the_list_of_an_indexed_library_loads_nothing_heavy(runs: Path) -> None:
    assert sweepctl("runs").status == 0
    code = (
        "import sys; from tools.cli.main import run; run(['runs', sys.argv[1]]); "
        "print([m for m in ('numpy', 'scipy', 'mcap', 'rich', 'matplotlib') if m in sys.modules], "
        "file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, runs], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stderr.strip() == "[]"
    assert len(done.stdout.splitlines()) == 4


def test_an_index_that_cannot_be_written_is_a_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(os, "access", lambda _path, mode: mode != os.W_OK)
    write_log(tmp_path / "a.mcap")
    assert run(["runs", "index", str(tmp_path)]) == 1
    printed = capsys.readouterr().err
    assert "cannot be written" in printed
    assert "the index has" not in printed
