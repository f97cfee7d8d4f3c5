"""Output of every command: messages on stderr, results on stdout, summaries as tables.

Text from outside is escaped here: see ``visible_text``.
"""

from __future__ import annotations

import json
import sys
from functools import cache
from typing import TYPE_CHECKING, Any

import click

from tools.cli.interrupt import set_done
from tools.cli.output_queue import QueuedStream
from tools.cli.visible_text import one_line, visible

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

_OUTCOME_STYLE = {"complete": "green", "stopped": "yellow", "timeout": "red", "fault": "red"}


@cache
def err() -> Console:
    """Return the console on stderr; the first call imports Rich and creates it."""
    from tools.cli.visible_console import VisibleConsole

    return VisibleConsole(stderr=True)


def plain_console() -> Console:
    """Return a new console on stdout."""
    from tools.cli.visible_console import VisibleConsole

    return VisibleConsole()


def is_drawable() -> bool:
    """Return whether stderr is a terminal on which a display can be redrawn in place."""
    return err().is_interactive


def inform(text: str, *, style: str | None = None) -> None:
    """Print a one-line message on stderr."""
    err().print(one_line(text), soft_wrap=True, style=style)


def inform_lines(text: str) -> None:
    """Print a message of several lines on stderr."""
    for line in text.splitlines():
        inform(line)


def print_error(text: str) -> None:
    """Print a one-line error on stderr, with the name of the command in front."""
    click.echo(f"{click.style('sweepctl:', fg='red', bold=True)} {one_line(text)}", err=True)


def ask(text: str) -> None:
    """Print a prompt on stderr without a line end, so that the answer follows it."""
    sys.stderr.write(visible(text))
    sys.stderr.flush()


def send(sequence: str) -> None:
    """Send a control sequence to the terminal on stderr, unescaped."""
    sys.stderr.write(sequence)
    sys.stderr.flush()


def drop_queued() -> None:
    """Drop queued output that has not been written to the terminal yet."""
    for stream in (err().file, plain_console().file):  # Rich may have replaced sys.stderr
        if isinstance(stream, QueuedStream) and stream.isatty():
            stream.drop_queued()


def write_line(*lines: str) -> None:
    """Write lines on stdout without wrapping or shortening them."""
    sys.stdout.write("".join(f"{visible(line)}\n" for line in lines))


def write_lines(text: str) -> None:
    """Write text of several lines on stdout, with its tabs and line ends unescaped."""
    sys.stdout.write(visible(text, keep="\n\t"))


def write_json(value: object) -> None:
    """Write one JSON object as a line on stdout; it is ASCII, so it needs no escaping."""
    sys.stdout.write(json.dumps(value) + "\n")


def flush() -> None:
    """Flush stdout, so that a program that reads it gets the output at once."""
    sys.stdout.flush()


def print_summary(summary: dict[str, Any], *, as_json: bool) -> None:
    """Print the summary of a run as one JSON object or as a table."""
    if as_json:
        write_json(summary)
        flush()
    else:
        plain_console().print(summary_table(summary))
    set_done()


def summary_table(summary: dict[str, Any]) -> Table:
    """Return the main results of a run's summary as a table."""
    from rich.table import Table
    from rich.text import Text

    coverage, wire = summary["coverage"], summary["wire"]
    style = _OUTCOME_STYLE.get(summary["outcome"], "")
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim")
    table.add_column(overflow="fold")  # not cut, so that the log's name can be copied
    what = [one_line(str(summary[k])) for k in ("room", "planner") if summary[k] is not None]
    if summary["seed"] is not None:
        what.append(f"seed {summary['seed']}")
    outcome = Text(_or_unknown(summary["outcome"]), style)
    if summary["reason"] is not None:
        outcome.append(f" - {one_line(summary['reason'])}", style="none")
    rows: list[tuple[str, str | Text | None]] = [
        ("run", ", ".join(what) or None),
        ("outcome", outcome),
        ("time", _with(summary["duration_s"], "{:.1f} s")),
        ("path", _path(summary)),
        ("swept by the mouth", _share(coverage, "mouth_sweepable", "of the sweepable floor")),
        ("swept in passing", _passing(coverage)),
        ("covered by the body", _share(coverage, "body_free", "of the floor (the paper's figure)")),
        ("90 % / 99 % after", _pair(summary["t90_s"], summary["t99_s"], "{:.0f} s")),
        ("largest hole", _with(summary["largest_hole_cm2"], "{:.0f} cm²")),
        ("pose error, end / max", _pose_error(summary["pose_error_m"])),
        ("collisions", _with(summary["collisions"], "{}")),
        ("energy", _with(summary["energy_wh"], "{:.2f} Wh")),
        (
            "link",
            (
                f"{wire['frames']['rx']} frames in, {wire['frames']['tx']} out, "
                f"{_or_unknown(wire['lost'])} lost, {_or_unknown(wire['crc_errors'])} damaged, "
                f"{(wire['bytes']['rx'] + wire['bytes']['tx']) / 1024:.0f} KiB"
            ),
        ),
        ("log", summary["log"]),
    ]
    for name, value in rows:
        if value is not None:
            # Names of rooms and reasons come from outside: Text takes them without markup.
            table.add_row(name, Text(value) if isinstance(value, str) else value)
    return table


def _or_unknown(value: object) -> str:
    return "unknown" if value is None else one_line(str(value))


def _with(value: float | None, form: str) -> str | None:
    return None if value is None else form.format(value)


def _share(coverage: dict[str, float | None], key: str, text: str) -> str | None:
    value = coverage[key]
    return None if value is None else f"{100 * value:.2f} % {text}"


def _passing(coverage: dict[str, float | None]) -> str | None:
    """Return the share without turns towards walls; None if it equals the coverage."""
    share = coverage.get("mouth_passing")
    if share is None or share == coverage["mouth_sweepable"]:
        return None
    return f"{100 * share:.2f} % of what the mouth reaches without turning towards walls"


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
