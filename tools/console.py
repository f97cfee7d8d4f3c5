"""What people read: a summary as a table, progress, one-line messages."""

from __future__ import annotations

import json
import sys
from functools import cache
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

_OUTCOME_STYLE = {"complete": "green", "stopped": "yellow", "timeout": "red", "fault": "red"}


@cache
def err() -> Console:
    """Where people read; made, and its library imported, when there is something to read."""
    from rich.console import Console

    return Console(stderr=True, highlight=False, emoji=False)


def say(text: str) -> None:
    """A line for people, on stderr."""
    err().print(text, soft_wrap=True, markup=False)


def complain(text: str) -> None:
    """An error in one line, on stderr."""
    click.echo(f"{click.style('sweepctl:', fg='red', bold=True)} {text}", err=True)


def print_summary(summary: dict[str, Any], *, as_json: bool) -> None:
    """A run's summary: one JSON object, or a table."""
    if as_json:
        sys.stdout.write(json.dumps(summary) + "\n")
        sys.stdout.flush()
        return
    plain_console().print(summary_table(summary))


def plain_console() -> Console:
    """Stdout, for what others have named: no word of a log or a file's name is markup."""
    from rich.console import Console

    return Console(highlight=False, markup=False, emoji=False)


def summary_table(summary: dict[str, Any]) -> Table:
    """The figures that people ask for first."""
    from rich.table import Table
    from rich.text import Text

    coverage, wire = summary["coverage"], summary["wire"]
    style = _OUTCOME_STYLE.get(summary["outcome"], "")
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim")
    table.add_column(overflow="fold")  # the log's name is for copying
    what = [str(summary[k]) for k in ("room", "planner") if summary[k] is not None]
    if summary["seed"] is not None:
        what.append(f"seed {summary['seed']}")
    outcome = Text.assemble((str(summary["outcome"]), style), f" - {summary['reason']}")
    rows: list[tuple[str, str | Text | None]] = [
        ("run", ", ".join(what) or None),
        ("outcome", outcome),
        ("time", _with(summary["duration_s"], "{:.1f} s")),
        ("path", _path(summary)),
        ("swept by the mouth", _share(coverage, "mouth_sweepable", "of what it can reach")),
        ("swept by the body", _share(coverage, "body_free", "of the floor (the paper's figure)")),
        ("90 % / 99 % after", _pair(summary["t90_s"], summary["t99_s"], "{:.0f} s")),
        ("largest hole", _with(summary["largest_hole_cm2"], "{:.0f} cm²")),
        ("pose error, end / most", _pose_error(summary["pose_error_m"])),
        ("collisions", _with(summary["collisions"], "{}")),
        ("energy", _with(summary["energy_wh"], "{:.2f} Wh")),
        (
            "wire",
            (
                f"{wire['frames']['rx']} frames in, {wire['frames']['tx']} out, "
                f"{wire['lost']} lost, {wire['crc_errors']} damaged, "
                f"{(wire['bytes']['rx'] + wire['bytes']['tx']) / 1024:.0f} KiB"
            ),
        ),
        ("log", summary["log"]),
    ]
    for name, value in rows:
        if value is not None:
            # Rooms and reasons are others' words: no markup.
            table.add_row(name, Text(value) if isinstance(value, str) else value)
    return table


def _with(value: float | None, form: str) -> str | None:
    return None if value is None else form.format(value)


def _share(coverage: dict[str, float | None], key: str, text: str) -> str | None:
    value = coverage[key]
    return None if value is None else f"{100 * value:.2f} % {text}"


def _pair(first: float | None, second: float | None, form: str) -> str | None:
    if first is None and second is None:
        return None
    return " / ".join("never" if v is None else form.format(v) for v in (first, second))


def _path(summary: dict[str, Any]) -> str | None:
    if summary["path_m"] is None:
        return None
    turns = "" if summary["turns"] is None else f", {summary['turns']} turns"
    return f"{summary['path_m']:.1f} m{turns}"


def _pose_error(error: dict[str, float | None]) -> str | None:
    if error["end"] is None or error["max"] is None:
        return None
    return f"{1000 * error['end']:.0f} / {1000 * error['max']:.0f} mm"
