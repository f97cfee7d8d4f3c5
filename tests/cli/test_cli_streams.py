"""Output streams: an ASCII terminal, a full disk, a closed stream."""

from __future__ import annotations

import json
import os
import subprocess
from typing import TYPE_CHECKING

import pytest
from mcap.writer import Writer

from support.processes import COMMAND
from support.root import ROOT
from tools.cli.main import run as main
from tools.cli.visible_console import VisibleConsole

if TYPE_CHECKING:
    from pathlib import Path

_SUMMARY = (
    *("room", "planner", "seed", "duration_s", "path_m", "turns", "collisions", "energy_wh"),
    *("t90_s", "t99_s", "largest_hole_cm2", "log"),
)
_COVERAGE = ("mouth_sweepable", "mouth_free", "body_reachable", "body_free", "eq8")
ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/größe", "json", 0)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    return path


def run(
    *arguments: str | Path, led: str = "", env: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run the command in a shell that redirects its streams as in ``led``."""
    words = [*COMMAND, *map(str, arguments)]
    return subprocess.run(
        ["/bin/sh", "-c", f'"$@" {led}', "sh", *words],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), **(env or {})},
        capture_output=True,
        check=False,
        text=True,
        timeout=60,
    )


def test_a_terminal_of_few_letters_gets_marks_in_their_place(log: Path) -> None:
    reported = run("info", log, env=ASCII)
    assert (reported.returncode, reported.stderr) == (0, "")
    assert "/gr??e" in reported.stdout.replace("\n", "")


@pytest.mark.parametrize("options", [(), ("--json",)])
def test_a_full_disk_is_reported_in_one_line(log: Path, options: tuple[str, ...]) -> None:
    reported = run("info", log, *options, led=">/dev/full")
    assert reported.returncode == 1
    assert reported.stderr == "sweepctl: cannot write the output: No space left on device\n"


def test_without_a_stdout_it_does_its_work(log: Path, tmp_path: Path) -> None:
    target = tmp_path / "whole.mcap"
    reported = run("recover", log, "--out", target, "--json", led=">&-")
    assert (reported.returncode, reported.stderr) == (0, "")
    whole = run("info", target, "--json")
    assert json.loads(whole.stdout)["messages"] == 1
    assert target.read_bytes().startswith(b"\x89MCAP"), "output was written to the file"


@pytest.mark.parametrize("size", ["²", "٣", "9" * 5000, "0", "-1", ""])
@pytest.mark.parametrize("name", ["COLUMNS", "LINES"])
def test_a_size_that_is_no_number_is_ignored(
    name: str, size: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, size)
    console = VisibleConsole()
    assert console.width > 0
    assert console.height > 0


def test_a_size_that_is_a_number_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "77")
    assert VisibleConsole().width == 77


def test_info_shortens_long_values_and_names_unknown_ones(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = dict.fromkeys((*_SUMMARY, "outcome", "reason"))
    ways = {"rx": 1, "tx": 1}
    wire = {"lost": None, "crc_errors": None, "frames": ways, "bytes": ways}
    tables = {"coverage": dict.fromkeys(_COVERAGE), "pose_error_m": {"end": None, "max": None}}
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.add_metadata("sweepctl", {"seed": "7" * 5000})
        summary = json.dumps({**known, **tables, "wire": wire}).encode()
        writer.add_attachment(1, 1, "summary.json", "application/json", summary)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    assert main(["info", str(path)]) == 0
    printed = capsys.readouterr().out
    assert "[... 4880 characters ...]" in printed
    assert "unknown lost" in printed
    assert "None" not in printed
