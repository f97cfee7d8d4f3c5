"""Output of an experiment: CSV, Markdown and HTML files, and tables or JSON on stdout."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.table import Table as RichTable

from tools.cli.console import plain_console, write_json
from tools.experiment import report
from tools.experiment.curves import MULTIPLES
from tools.experiment.paired_differences import matched
from tools.experiment.store import write_csv, writing
from tools.experiment.tables import room_file
from tools.experiment.trials import TrialKind, is_made, room_of
from tools.experiment.unswept_causes import CAUSES
from tools.experiment.version_comparison import version_of, versions_tables

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tools.experiment.store import Row
    from tools.experiment.tables import Table

_PLAIN_WIDTH = 220
"""Width of tables that are not printed on a terminal, characters."""
_NAMES = ("kind", "room", "planner", "noise", "seed", "robot")


def write_results(
    out: Path,
    title: str,
    command: str,
    rows: Sequence[Row],
    before: Sequence[Row] | None = None,
) -> list[Table]:
    """Write all files of the results and return the tables.

    ``before`` contains results of another version of the code. They are compared run by run.

    Raises:
        ExperimentFolderError: a file cannot be written.

    """
    with writing(out):
        write_csv(out / "runs.csv", rows)
        swept = [row for row in rows if "curve" in row]
        if swept:
            write_csv(out / "curves.csv", _curves(swept))
        cycles = [row for row in rows if row["kind"] == TrialKind.CYCLES]
        if cycles:
            points = [{"seed": row["seed"], **point} for row in cycles for point in row["offsets"]]
            write_csv(out / "cycles.csv", points)
            smoothing: list[list[float]] = next(
                (row["smoothing"] for row in cycles if row.get("smoothing")), []
            )
            names = ("time_s", "before_m_s", "after_m_s")
            write_csv(out / "smoothing.csv", [dict(zip(names, p, strict=True)) for p in smoothing])
        limits = [row for row in rows if "loss" in row]
        if limits:
            losses = [
                {**_named(row), **{cause.replace(" ", "_"): row["loss"][cause] for cause in CAUSES}}
                for row in limits
            ]
            write_csv(out / "losses.csv", losses)
        _write_rooms(out / "rooms", rows)
        made = report.all_tables(rows, str(out / "rooms"))
        pairs = matched(before or (), rows)
        if before is not None:
            made = [*versions_tables(pairs, version_of(before), version_of(rows)), *made]
        (out / "tables.md").write_text(report.markdown(made), encoding="utf-8")
        page = report.render(title, command, rows, made, pairs)
        (out / "report.html").write_text(page, encoding="utf-8")
    return made


def print_tables(made: Sequence[Table], out: Path) -> None:
    """Print the tables on stdout."""
    console = plain_console()
    if not console.is_terminal:
        console.width = _PLAIN_WIDTH
    for table in made:
        shown = RichTable(title=table.title, title_justify="left", box=None)
        for name in table.head:
            shown.add_column(name)
        for line in table.rows:
            shown.add_row(*line)
        console.print(shown)
        console.print()
    console.print(f"report: {out / 'report.html'}", soft_wrap=True)


def print_json(made: Sequence[Table], out: Path, rows: Sequence[Row], failed: list[str]) -> None:
    """Print one JSON object on stdout."""
    summary: dict[str, Any] = {
        "runs": len(rows),
        "failed": failed,
        "report": str(out / "report.html"),
        "tables": {
            table.title: [dict(zip(table.head, line, strict=True)) for line in table.rows]
            for table in made
        },
    }
    write_json(summary)


def _named(row: Row) -> Row:
    return {name: row[name] for name in _NAMES}


def _curves(rows: Sequence[Row]) -> list[Row]:
    names = {
        "coverage": "mouth_by_time",
        "by_path": "mouth_by_path",
        "by_energy": "mouth_by_energy",
        "energy_wh": "energy_wh",
    }
    return [
        {
            **_named(row),
            "multiple": multiple,
            **{
                name: row["curve"][key][k] if key in row["curve"] else None
                for key, name in names.items()
            },
        }
        for row in rows
        for k, multiple in enumerate(MULTIPLES)
    ]


def _write_rooms(folder: Path, rows: Sequence[Row]) -> None:
    """Write the generated rooms and layouts as files, so that ``simulate`` can repeat a run."""
    drawn = {
        (row["room"], row["robot"], row["robot_hash"], row.get("radius_m", 0.0))
        for row in rows
        if is_made(row["room"])
    }
    for name, robot, robot_hash, radius_m in sorted(drawn):
        folder.mkdir(exist_ok=True)
        path = folder / room_file(name, robot, robot_hash)
        path.write_text(room_of(name, radius_m).to_json() + "\n", encoding="utf-8")
