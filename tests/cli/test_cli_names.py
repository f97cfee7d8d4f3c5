"""Names in logs and of files: brackets are not markup, and a name may be invalid UTF-8."""

from __future__ import annotations

import os
from pathlib import Path

import pyarrow.parquet
import pytest
from mcap.writer import Writer

from support.cli import sweepctl

ODD = b"n\xff\xfe"


def write_foreign(path: Path) -> Path:
    """Write a log of another program with brackets in its names."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="x[/]", library="y[/y]")
        schema = writer.register_schema("my[red]Schema", "jsonschema", b"{}")
        for topic in ("/[/a]", "/[red]b", ":smile:"):
            channel = writer.register_channel(topic, "json", schema)
            writer.add_message(channel, 1, b'{"v": 1}', 1)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    return path


def test_brackets_are_shown_as_they_are(tmp_path: Path) -> None:
    log = write_foreign(tmp_path / "run[bold].mcap")
    reported = sweepctl("info", log)
    assert (reported.status, reported.err) == (0, "")
    for name in ("run[bold].mcap", "/[/a]", "/[red]b", ":smile:", "my[red]Schema"):
        assert name in "".join(reported.out.split()), name
    both = sweepctl("diff", log, log)
    assert both.status == 0
    assert "run[bold].mcap" in both.out


def test_a_log_whose_name_is_no_utf8_is_read_like_any(tmp_path: Path) -> None:
    odd = Path(os.fsdecode(os.fsencode(tmp_path) + b"/" + ODD + b".mcap"))
    try:
        write_foreign(odd)
    except OSError:  # a file system that accepts only UTF-8 has no such files
        odd = write_foreign(tmp_path / "n.mcap")
    page, rrd, tables = tmp_path / "o.html", tmp_path / "o.rrd", tmp_path / "tables"
    assert sweepctl("report", odd, "--out", page).status == 0
    assert "<h1>n" in page.read_text("utf-8")
    assert sweepctl("diff", odd, odd, "--out", tmp_path / "two.html").status == 0
    assert sweepctl("view", odd, "--save", rrd).status == 0
    assert rrd.read_bytes().startswith(b"RRF2")
    assert sweepctl("export", odd, "--out", tables, "--topic", ":smile:").status == 0
    (table,) = tables.iterdir()
    notes = pyarrow.parquet.read_schema(table).metadata
    assert notes[b"sweepctl.log"].decode() == os.fsencode(odd.name).decode("utf-8", "replace")


@pytest.mark.parametrize(
    ("command", "library"), [(("view", "--save"), "Rerun"), (("export", "--out"), "Parquet")]
)
def test_a_library_that_needs_utf8_is_named(
    tmp_path: Path, command: tuple[str, str], library: str
) -> None:
    log = write_foreign(tmp_path / "log.mcap")
    target = Path(os.fsdecode(os.fsencode(tmp_path) + b"/" + ODD))
    done = sweepctl(command[0], log, command[1], target)
    assert done.status == 1
    assert f"{library} needs a name in UTF-8" in done.line


def test_dollars_in_a_name_are_no_mathematics(tmp_path: Path) -> None:
    log = write_foreign(tmp_path / r"a$\frac$b.mcap")
    for command in (
        ("report", log, "--out", tmp_path / "o.html", "--png", tmp_path / "report.png"),
        ("diff", log, log, "--out", tmp_path / "diff.png"),
        ("view", log, "--png", tmp_path / "view.png"),
    ):
        assert sweepctl(*command).status == 0
    for name in ("report", "diff", "view"):
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
