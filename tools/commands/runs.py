"""``sweepctl runs``: list, select, tag and compare recorded runs."""

from __future__ import annotations

import errno
import os
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from tools.cli import options
from tools.cli.console import err, inform, write_json, write_line
from tools.cli.log_file import LogPath
from tools.cli.parallel_options import in_order, parallel_options, pool_of
from tools.cli.paths import PathName, is_there

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from bridge.library.index import LogReaders, ReadLog
    from bridge.library.library import Run
    from bridge.library.selection import Selection

_DEFAULT = "list"
"""Default subcommand."""


class RunsGroup(click.Group):
    """Group with the default subcommand ``list``."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Insert the default subcommand."""
        asks_help = args and args[0] in ctx.help_option_names
        is_named = args and (args[0] in self.commands or asks_help)
        if not is_named and not (ctx.resilient_parsing and not args):
            args = [_DEFAULT, *args]
        return super().parse_args(ctx, args)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[Any]:
        """Complete the subcommands, and the options and folders of the default one."""
        inner = self.commands[_DEFAULT]
        with inner.make_context(_DEFAULT, [], parent=ctx, resilient_parsing=True) as context:
            return [
                *super().shell_complete(ctx, incomplete),
                *inner.shell_complete(context, incomplete),
            ]


@click.group(
    "runs",
    cls=RunsGroup,
    no_args_is_help=False,
    epilog="Example:  sweepctl runs list --where \"planner = 'paper' AND path_m > 1\"",
)
def command() -> None:
    """List, select, tag and compare recorded runs.

    `sweepctl runs [DIR]... [--where SQL] [--sort COLUMN] [--json]` is short for `sweepctl runs
    list ...`.

    An index in each folder of logs (.sweepctl-runs.sqlite) keeps the list fast. It is updated
    whenever it is used: only logs that are new or have changed are read.
    """


def _columns(
    ctx: click.Context,  # noqa: ARG001 - click's interface
    param: click.Parameter,  # noqa: ARG001 - click's interface
    incomplete: str,
) -> list[str]:
    from bridge.library.columns import NAMES

    return [name for name in NAMES if name.startswith(incomplete)]


def _known_tags(
    ctx: click.Context,
    param: click.Parameter,  # noqa: ARG001 - click's interface
    incomplete: str,
) -> list[str]:
    """Return the tags of the runs."""
    from bridge.errors import BridgeError
    from bridge.library.latest import DEFAULT_FOLDER
    from bridge.library.library import Library
    from bridge.library.selection import Selection

    library = Library(ctx.params.get("folders") or (DEFAULT_FOLDER,))
    try:
        library.refresh()
        runs = library.select(Selection())
    except BridgeError:  # completion must not print errors
        return []
    tags = {tag for run in runs for tag in run.values["tags"].split()}
    return [tag for tag in sorted(tags) if tag.startswith(incomplete)]


def _selecting(f: Callable[..., object]) -> Callable[..., object]:
    """Add the folders and the options of a selection."""
    for add in (
        click.option(
            "--last",
            type=click.IntRange(min=1),
            metavar="N",
            help="Only the last N runs of the list.",
        ),
        click.option(
            "--tag",
            "tags",
            multiple=True,
            metavar="TAG",
            shell_complete=_known_tags,
            help="Only runs with this tag.",
        ),
        click.option(
            "--where",
            default="",
            metavar="SQL",
            help="Only runs for which this SQL condition over the columns is true. `sweepctl runs "
            "columns` lists the columns.",
        ),
        click.argument(
            "folders",
            nargs=-1,
            metavar="[DIR]...",
            type=PathName(exists=True, file_okay=False),
        ),
    ):
        f = add(f)
    return f


@command.command("list", epilog="Example:  sweepctl runs list runs --sort -coverage --last 20")
@_selecting
@click.option(
    "--sort",
    default="date",
    show_default=True,
    metavar="COLUMN",
    shell_complete=_columns,
    help="Column to sort by; -COLUMN reverses the order.",
)
@options.json_option
def _list(  # noqa: PLR0913 - one parameter per option
    *,
    folders: tuple[Path, ...],
    where: str,
    tags: tuple[str, ...],
    last: int | None,
    sort: str,
    as_json: bool,
) -> int:
    """List the runs in each DIR and in the folders below it.

    DIR is `runs` by default. The newest run is the last line. With --json all columns are printed.
    """
    from bridge.library.selection import Selection

    library, runs = _select(folders, Selection(where, sort, tags, last))
    if as_json:
        unreadable = [{"log": str(path), "problem": text} for path, text in library.unreadable]
        write_json({"runs": [run.values for run in runs], "unreadable": unreadable})
        return 0
    for path, text in library.unreadable:
        inform(f"{path}: cannot be read: {text}", style="yellow")
    if not runs:
        inform("no runs")
        return 0
    write_line(*_aligned(_HEAD, [_cells(run) for run in runs]))
    return 0


@command.command("columns", epilog="Example:  sweepctl runs columns --json")
@options.json_option
def _show_columns(*, as_json: bool) -> int:
    """List the columns for --where and --sort, with their meanings."""
    from bridge.library.columns import COLUMNS

    if as_json:
        found = [{"name": c.name, "type": c.kind, "meaning": c.meaning} for c in COLUMNS]
        write_json({"columns": found})
        return 0
    write_line(*_aligned(("column", "type", "meaning"), [c[:3] for c in COLUMNS]))
    return 0


@command.command("tag", epilog="Example:  sweepctl runs tag latest good carpet")
@click.argument("file", type=LogPath())
@click.argument("tags", nargs=-1, metavar="[TAG]...")
@click.option("--remove", is_flag=True, help="Remove these tags instead of adding them.")
@options.json_option
def _tag(*, file: Path, tags: tuple[str, ...], remove: bool, as_json: bool) -> int:
    """Add tags to the run in FILE; without TAG show them.

    A tag is a word of letters, digits and _ . + -. Tags and notes are in the index beside the log.
    They follow a log that is renamed, or moved between folders that one `sweepctl runs` lists.
    """
    from bridge.library.library import mark_run

    if remove and not tags:
        raise click.UsageError("--remove needs the tags to remove")
    _check_there(file)
    marks = mark_run(file, remove=tags) if remove else mark_run(file, add=tags)
    return _print_marks(file, marks.tags, marks.note, as_json=as_json)


@command.command("note", epilog='Example:  sweepctl runs note latest "left brush replaced"')
@click.argument("file", type=LogPath())
@click.argument("text", required=False)
@options.json_option
def _note(*, file: Path, text: str | None, as_json: bool) -> int:
    """Set the note of the run in FILE; without TEXT show it.

    An empty TEXT removes the note.
    """
    from bridge.library.library import mark_run

    _check_there(file)
    marks = mark_run(file, note=text)
    return _print_marks(file, marks.tags, marks.note, as_json=as_json)


def _check_there(file: Path) -> None:
    """Check that a log exists.

    Raises:
        LogReadError: it does not exist.

    """
    from bridge.record.errors import LogReadError

    if not is_there(file):
        raise LogReadError(file, os.strerror(errno.ENOENT))


def _print_marks(file: Path, tags: tuple[str, ...], note: str | None, *, as_json: bool) -> int:
    if as_json:
        write_json({"log": str(file), "tags": list(tags), "note": note})
    else:
        write_line(f"{file}: {' '.join(tags) or 'no tags'}", *([f"  {note}"] if note else []))
    return 0


@command.command(
    "compare", epilog="Example:  sweepctl runs compare --by planner --out planners.html"
)
@_selecting
@click.option(
    "--by",
    default="planner",
    show_default=True,
    metavar="COLUMN",
    shell_complete=_columns,
    help="Column by which the runs are grouped.",
)
@click.option(
    "--out",
    type=PathName(dir_okay=False),
    help="Write a page (.html) or a picture (.png).",
)
@click.option("--force", is_flag=True, help="Replace the output if it exists.")
@options.json_option
def _compare(  # noqa: PLR0913 - one parameter per option
    *,
    folders: tuple[Path, ...],
    where: str,
    tags: tuple[str, ...],
    last: int | None,
    by: str,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Compare groups of runs: coverage, time, path, collisions, energy.

    The figures are those of the index, so no log is read. `sweepctl diff` compares two runs in
    detail.
    """
    from bridge.library.columns import NAMES
    from bridge.library.selection import Selection
    from bridge.view.report.selection import group_rows, grouped, groups_json

    _check_output(out, force=force)
    if by not in NAMES:
        from bridge.spelling import nearest

        near = nearest(by, NAMES)
        hint = f"did you mean {near}?" if near else "`sweepctl runs columns` lists them"
        raise click.BadParameter(f"no column {by!r}; {hint}", param_hint="'--by'")
    selection = Selection(where, "date", tags, last)
    _, runs = _select(folders, selection)
    groups = grouped([run.values for run in runs], by)
    if out is not None:
        from bridge.view.output import write
        from bridge.view.report.selection import comparison_page, comparison_picture

        is_picture = out.suffix.lower() == ".png"
        page = "" if is_picture else comparison_page(groups, by, _in_words(folders, selection))
        write(out, comparison_picture(groups) if is_picture else page.encode(errors="replace"))
    if as_json:
        write_json({**groups_json(groups, by), "out": None if out is None else str(out)})
    elif out is not None:
        inform(f"wrote {out}")
    else:
        write_line(*_aligned(*group_rows(groups, by)))
    return 0


@command.command(
    "heatmap",
    epilog="Example:  sweepctl runs heatmap --where \"planner = 'paper'\" --out missed.html",
)
@_selecting
@click.option(
    "--out",
    required=True,
    type=PathName(dir_okay=False),
    help="Page (.html) or picture (.png) to write.",
)
@click.option("--force", is_flag=True, help="Replace the output if it exists.")
@options.json_option
def _heatmap(  # noqa: PLR0913 - one parameter per option
    *,
    folders: tuple[Path, ...],
    where: str,
    tags: tuple[str, ...],
    last: int | None,
    out: Path,
    force: bool,
    as_json: bool,
) -> int:
    """Draw which floor the selected runs miss, one map for each room.

    The poses of each log are read: the truth where it is known, else the estimate. A run that was
    stopped early misses much; `--where "outcome = 'complete'"` leaves it out.
    """
    from bridge.library.selection import Selection
    from bridge.view.output import write
    from bridge.view.report.heatmap import gather_misses, heatmap_page, heatmap_picture

    _check_output(out, force=force)
    selection = Selection(where, "date", tags, last)
    _, runs = _select(folders, selection)
    with _progress("reading poses") as show:
        misses = gather_misses([run.path for run in runs], lambda done: show(done, len(runs)))
    for path, reason in misses.unused:
        inform(f"{path}: not used: {reason}", style="yellow")
    if not misses.rooms:
        from bridge.library.errors import LibraryError

        raise LibraryError("no selected run has a known room and a pose")
    if out.suffix.lower() == ".png":
        write(out, heatmap_picture(misses))
    else:
        page = heatmap_page(misses, _in_words(folders, selection))
        write(out, page.encode(errors="replace"))
    if as_json:
        write_json({**misses.as_json(), "out": str(out)})
    else:
        for room in misses.rooms:
            always = f"{room.area_cm2(1.0):.0f} cm² missed by every run"
            inform(f"{room.name}: {room.runs} runs, {always}")
        inform(f"wrote {out}")
    return 0


@command.command("index", epilog="Example:  sweepctl runs index runs --jobs 2")
@click.argument(
    "folders",
    nargs=-1,
    metavar="[DIR]...",
    type=PathName(exists=True, file_okay=False),
)
@parallel_options
@options.json_option
def _index(
    *, folders: tuple[Path, ...], jobs: int | None, scheduler: str | None, as_json: bool
) -> int:
    """Update the index of each DIR and of the folders below it, in parallel.

    Every use of the index updates it; this command is for many new logs at once.
    """
    from bridge.library.index import read_log
    from bridge.library.selection import Selection

    read_count = 0

    with pool_of(1 << 16, jobs, scheduler) as pool:

        def read(logs: list[tuple[Path, int]]) -> Iterator[ReadLog]:
            nonlocal read_count
            absolute = [(path.absolute(), modified_ns) for path, modified_ns in logs]
            for _, found in in_order(pool, read_log, absolute):
                read_count += 1
                yield found

        library, runs = _select(folders, Selection(), read)
    for path, reason in library.unreadable:
        inform(f"{path}: {reason}")
    if as_json:
        write_json({"read": read_count, "runs": len(runs), "unreadable": len(library.unreadable)})
    elif not library.unstored:
        inform(f"{read_count} logs read; the index has {len(runs)} runs")
    return 1 if library.unstored else 0


# ---- shared -----------------------------------------------------------------------------


def _check_output(out: Path | None, *, force: bool) -> None:
    from tools.cli.outputs import PAGE, PNG, check_format, check_outputs

    check_outputs([out], [], force=force)
    check_format("--out", out, *PAGE, *PNG)


def _select(
    folders: tuple[Path, ...], selection: Selection, read: LogReaders | None = None
) -> tuple[Any, list[Run]]:
    """Update the indexes and return the library with the selected runs."""
    from bridge.library.errors import LibraryError
    from bridge.library.index import read_here
    from bridge.library.latest import DEFAULT_FOLDER
    from bridge.library.library import Library

    if not folders and not DEFAULT_FOLDER.is_dir():
        raise LibraryError(f"there is no folder {DEFAULT_FOLDER}: give the folder of the logs")
    library = Library(folders or (DEFAULT_FOLDER,))
    with _progress("reading logs") as show:
        library.refresh(show, read or read_here)
    for folder in library.unstored:
        inform(f"{folder} cannot be written: without an index all its logs are read each time")
    return library, library.select(selection)


@contextmanager
def _progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """Show the progress on a terminal, if there are more than a few logs."""
    if not sys.stderr.isatty():
        yield lambda _done, _all: None
        return

    status: Any = None

    def show(done: int, count: int) -> None:
        nonlocal status
        if count > _SHOWN_FROM:
            if status is None:
                status = err().status("")
                status.start()
            status.update(f"{what}: {done} of {count}")

    try:
        yield show
    finally:
        if status is not None:
            status.stop()


_SHOWN_FROM = 50
"""Minimum number of logs for which the progress is shown. Fewer logs take less than a second."""


def _in_words(folders: tuple[Path, ...], selection: Selection) -> str:
    where = ", ".join(map(str, folders)) or "runs"
    text = f"Runs in {where}"
    text += f" where {selection.where}" if selection.where.strip() else ""
    text += "".join(f", tagged {tag}" for tag in selection.tags)
    return text + (f", the last {selection.last}" if selection.last else "") + "."


_HEAD = (
    *("date", "room", "planner", "seed", "outcome", "swept", "time", "path", "coll.", "events"),
    *("lost", "tags", "log"),
)


def _cells(run: Run) -> tuple[str, ...]:
    from bridge.library.columns import number_cell

    row = run.values
    return (
        (row["date"] or "-").replace("T", " ").removesuffix("Z"),
        row["room"] or "-",
        row["planner"] or "-",
        number_cell(row, "seed", "{:.0f}"),
        row["outcome"] or ("no end" if not row["whole"] else "-"),
        number_cell(row, "coverage", "{:.2f} %", 100.0),
        number_cell(row, "duration_s", "{:.0f} s"),
        number_cell(row, "path_m", "{:.1f} m"),
        number_cell(row, "collisions", "{:.0f}"),
        number_cell(row, "supervision", "{:.0f}"),
        number_cell(row, "lost", "{:.0f}"),
        row["tags"].strip() or "-",
        row["log"],
    )


_RIGHT = frozenset({"seed", "swept", "time", "path", "coll.", "events", "lost", "runs", "complete"})


def _aligned(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Align the columns. A table of Rich would take seconds for 10 000 rows."""
    from tools.cli.visible_text import one_line

    lines = [tuple(map(one_line, row)) for row in (head, *rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    sides = [">" if name in _RIGHT or "," in name else "<" for name in head]
    form = "  ".join(f"{{:{side}{width}}}" for side, width in zip(sides, widths, strict=True))
    return [form.format(*line).rstrip() for line in lines]
