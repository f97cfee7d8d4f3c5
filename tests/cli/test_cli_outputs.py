"""Commands that read a log replace an existing file only on request."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from mcap.writer import Writer

from bridge.record.errors import LogWriteError
from bridge.view.rerun import screenshot
from support.cli import short_runs, sweepctl
from tools.cli.main import run


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return short_runs(tmp_path_factory)[0].log


@pytest.mark.parametrize("option", ["--png", "--save", "--screenshot"])
def test_view_replaces_nothing_unless_asked(log: Path, tmp_path: Path, option: str) -> None:
    target = tmp_path / "kept"
    target.write_text("another's")
    done = sweepctl("view", log, option, target)
    assert done.status == 1
    assert done.line.count("\n") <= 1
    assert f"{target} exists; give another name, or --force to replace it" in done.line
    assert target.read_text() == "another's"


def test_view_replaces_only_where_asked(log: Path, tmp_path: Path) -> None:
    target, empty = tmp_path / "old.png", tmp_path / "made-by-mktemp.png"
    target.write_text("another's")
    empty.touch()
    assert sweepctl("view", log, "--png", target, "--force").status == 0
    assert target.read_bytes().startswith(b"\x89PNG")
    assert sweepctl("view", log, "--png", empty).status == 1
    assert not empty.read_bytes(), "an empty file counts as existing"


def test_view_writes_all_that_it_was_asked_for(log: Path, tmp_path: Path) -> None:
    png, rrd = tmp_path / "run.png", tmp_path / "run.rrd"
    assert sweepctl("view", log, "--png", png, "--save", rrd).status == 0
    assert png.read_bytes().startswith(b"\x89PNG")
    assert rrd.read_bytes().startswith(b"RRF2")


@pytest.mark.parametrize(
    "command",
    [
        ("view", "--png"),
        ("view", "--save"),
        ("view", "--screenshot"),
        ("report", "--out"),
        ("report", "--png"),
    ],
)
def test_the_log_itself_is_never_written_over(
    log: Path, tmp_path: Path, command: tuple[str, str]
) -> None:
    copy = tmp_path / "run.mcap"
    copy.write_bytes(log.read_bytes())
    name, option = command
    done = sweepctl(name, copy, option, tmp_path / "." / "run.mcap", "--force")
    assert done.status == 1
    assert "it is also the input; give another name" in done.line
    assert copy.read_bytes() == log.read_bytes()
    both = sweepctl("diff", log, copy, "--out", copy, "--force")
    assert both.status == 1
    assert copy.read_bytes() == log.read_bytes()


def test_two_outputs_of_one_name_are_rejected(log: Path, tmp_path: Path) -> None:
    page = tmp_path / "page"
    assert sweepctl("report", log, "--out", page, "--png", page).status == 2
    assert sweepctl("view", log, "--save", page, "--png", page).status == 2
    assert not page.exists()


class Still:
    """A viewer whose picture never changes."""

    def save_screenshot(self, path: str) -> None:
        Path(path).write_bytes(b"picture")


def test_a_screenshot_that_cannot_be_written_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(screenshot, "DRAWING_S", 0.0)
    with pytest.raises(LogWriteError, match=r"cannot write /proc/none/x\.png"):
        screenshot.take_at_rest(Still(), tmp_path / "shot.png", Path("/proc/none/x.png"))  # type: ignore[arg-type]


def test_an_interrupted_export_reports_its_partial_files(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("bridge.convert.export.export", interrupted)
    assert run(["export", str(log), "--out", str(tmp_path / "tables")]) == 1
    printed = capsys.readouterr().err
    assert "interrupted: the tables in" in printed
    assert printed.count("\n") == 1


@pytest.mark.parametrize(
    ("command", "name", "wanted"),
    [
        (("view", "--png"), "foo.jpg", ".png"),
        (("view", "--screenshot"), "foo.svg", ".png"),
        (("view", "--save"), "foo.png", ".rrd"),
        (("report", "--png"), "foo.PDF", ".png"),
        (("report", "--out"), "foo.pdf", ".html or .htm"),
        (("recover", "--out"), "foo.html", ".mcap"),
    ],
)
def test_a_name_of_another_format_is_rejected(
    log: Path, tmp_path: Path, command: tuple[str, str], name: str, wanted: str
) -> None:
    done = sweepctl(command[0], log, command[1], tmp_path / name)
    assert done.status == 2
    assert f"the format is {wanted}, not {Path(name).suffix.lower()}" in done.line
    assert not (tmp_path / name).exists()


def test_diff_writes_a_page_or_a_picture_and_reports_so(log: Path, tmp_path: Path) -> None:
    done = sweepctl("diff", log, log, "--out", tmp_path / "foo.pdf")
    assert done.status == 2
    assert "the format is .html or .htm or .png, not .pdf" in done.line
    assert sweepctl("diff", log, log, "--out", tmp_path / "both.PNG").status == 0
    assert (tmp_path / "both.PNG").read_bytes().startswith(b"\x89PNG")
    assert sweepctl("diff", log, log, "--out", tmp_path / "run-1.5").status == 0
    assert (tmp_path / "run-1.5").read_bytes().startswith(b"<!doctype html>")


def test_a_full_disk_ends_a_rerun_file_in_a_line(log: Path, tmp_path: Path) -> None:
    rrd = tmp_path / "run.rrd"
    rrd.symlink_to("/dev/full")
    done = sweepctl("view", log, "--save", rrd, "--force")
    assert done.status == 1
    assert f"cannot write {rrd}: " in done.err
    assert "Traceback" not in done.err


@pytest.mark.filterwarnings("default")
def test_a_warning_of_a_library_is_a_line_of_ours(tmp_path: Path) -> None:
    """A library's warning may quote text from the log, here a character that no font has."""
    path = tmp_path / "named.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        summary = json.dumps({"room": "\x1b", "planner": "paper"}).encode()
        writer.add_attachment(1, 1, "summary.json", "application/json", summary)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    done = sweepctl("view", path, "--png", tmp_path / "named.png")
    assert done.status == 0
    assert "warning: Glyph 27 (\\x1b) missing" in done.err
    assert "\x1b" not in done.err


@pytest.mark.parametrize(
    "words",
    [
        ("simulate", "case-1", "--out", "-"),
        ("connect", "/dev/none", "--out", "-"),
        ("connect", "/dev/none", "--no-record", "--out", "a.mcap"),
        ("connect", "/dev/none", "--no-record", "--fsync"),
        ("connect", "/dev/none", "--no-record", "--serve"),
    ],
)
def test_a_log_is_a_file_or_there_is_none(words: tuple[str, ...]) -> None:
    done = sweepctl(*words)
    assert done.status == 2
    assert "log" in done.line
