"""The report of an experiment as a self-contained HTML page, and its tables as Markdown."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from bridge.view.report.page import Tile, document, gallery, section, table
from tools.cli.planners import DEFAULT_PLANNER
from tools.experiment import compare_tables, figures, layout_tables, paper_tables, tables
from tools.experiment.planner_pairs import planner_pairs_table
from tools.experiment.sensitivity import sensitivity_table
from tools.experiment.trials import TrialKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tools.experiment.paired_differences import Pair
    from tools.experiment.store import Row
    from tools.experiment.tables import Table


@dataclass(frozen=True, slots=True)
class Results:
    """The rows of an experiment, by kind."""

    rows: Sequence[Row]

    def of(self, *kinds: TrialKind) -> list[Row]:
        """Return the rows of these kinds."""
        return [row for row in self.rows if row["kind"] in kinds]

    @property
    def levels(self) -> list[str]:
        """Noise levels of our planners' runs, in the order of the rows."""
        return list(dict.fromkeys(row["noise"] for row in self.of(TrialKind.RUN, TrialKind.LIMITS)))


def all_tables(rows: Sequence[Row], rooms_folder: str) -> list[Table]:
    """Return every table for which there are rows."""
    results = Results(rows)
    runs, cycles, limits = (
        results.of(TrialKind.RUN),
        results.of(TrialKind.CYCLES),
        results.of(TrialKind.LIMITS),
    )
    made = _paper_tables(results)
    if cycles:
        made.append(paper_tables.cycle_table(cycles))
    if limits:
        made.append(compare_tables.limit_table(limits))
        made += [compare_tables.limit_room_table(limits, noise) for noise in results.levels]
    ours = runs + limits
    if ours:
        made.append(tables.planner_table(ours))
        made += [tables.curve_table(ours, curve) for curve in ("coverage", "by_energy")]
        swept = ours + results.of(TrialKind.ZIMABLUE)
        paired = [
            planner_pairs_table(swept, curve, DEFAULT_PLANNER)
            for curve in ("coverage", "by_energy")
        ]
        made += [table for table in (tables.robot_table(ours), *paired) if table.rows]
    if results.of(TrialKind.SENSITIVITY):
        made.append(sensitivity_table(results.of(TrialKind.RUN, TrialKind.SENSITIVITY)))
    if compare_tables.shared(rows) and results.of(TrialKind.ZIMABLUE):
        made += [compare_tables.zimablue_table(rows, curve) for curve in ("coverage", "by_path")]
    if ours:
        made.append(tables.energy_table(ours))
        made += [tables.room_table(ours, noise) for noise in results.levels]
        made.append(tables.worst_table(ours, rooms_folder))
    return made


def _paper_tables(results: Results) -> list[Table]:
    """Return the tables of the paper's experiments."""
    rows, runs, made = results.rows, results.of(TrialKind.RUN), []
    if any(row["room"] in paper_tables.PAPER_SHARES and row["planner"] == "paper" for row in runs):
        made.append(paper_tables.paper_table(runs))
    if results.of(TrialKind.BESIDE):
        made.append(paper_tables.beside_table(rows))
    if results.of(TrialKind.LAYOUT):
        made.append(layout_tables.layout_table(rows))
    if results.of(TrialKind.RANGES):
        made.append(layout_tables.range_table(rows))
    return made


_PICTURES = 60
"""Maximum number of pictures of paths; each has 18 kB."""


def render(
    title: str,
    command: str,
    rows: Sequence[Row],
    tables_made: Sequence[Table],
    pairs: Sequence[Pair] = (),
) -> str:
    """Return the HTML page with the tables and the figures of the rows.

    ``pairs`` contains each run with the same run of another version of the code.
    """
    facts = [
        ("runs", len(rows)),
        ("rooms", len({row["room"] for row in rows})),
        ("planners", len({row["planner"] for row in rows})),
        ("seeds", len({row["seed"] for row in rows})),
    ]
    parts = [section(heading, svg, note) for heading, svg, note in _figures(rows)]
    if pairs:
        note = "Each dot is a pair of runs; above the line the new version is higher."
        parts.insert(0, section("Run by run", figures.versions_figure(pairs), note))
    parts += [table(made.title, made.head, made.rows, note=made.note) for made in tables_made]
    firsts = [
        runs[0]
        for runs in tables.group(rows, "room", "planner", "noise", "robot").values()
        if runs[0].get("path") and runs[0]["kind"] != TrialKind.RANGES
    ]
    if firsts:
        note = "The first seed of each. Dot: start; square: end."
        if len(firsts) > _PICTURES:
            firsts = sorted(firsts, key=lambda row: row.get("mouth_sweepable", 1.0))[:_PICTURES]
            note = f"The {_PICTURES} first seeds with the lowest coverage. Dot: start; square: end."
        parts.append(gallery("Paths", [figures.path_picture(row) for row in firsts], note))
    lead = (
        f"<p>Made by <code>{escape(command)}</code>. Equal seeds give equal figures. "
        "Coverage is measured from the true path.</p>"
    )
    return document(title, "", lead, [Tile(str(count), name) for name, count in facts], parts)


def markdown(made: Sequence[Table]) -> str:
    """Return the tables as Markdown."""
    parts = []
    for one in made:
        parts += [f"## {one.title}", "", _line(one.head), _line(["---"] * len(one.head))]
        parts += [_line(row) for row in one.rows]
        parts += ["", *([one.note, ""] if one.note else [])]
    return "\n".join(parts)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _figures(rows: Sequence[Row]) -> list[tuple[str, str, str]]:
    """Return heading, SVG text and note of each figure."""
    results = Results(rows)
    made = []
    cycles = results.of(TrialKind.CYCLES)
    if any(row["offsets"] for row in cycles):
        note = "Seven U-shaped cycles with noise paper on an open floor. Each grey line is a seed."
        made.append(("Fig. 15: keeping the path", figures.cycles_figure(cycles), note))
    for row in cycles:
        if row.get("smoothing"):
            note = "The first seconds of seed 0 of the same runs: commands at 50 Hz."
            made.append(("Fig. 12: velocity smoothing", figures.smoothing_figure(row), note))
    if results.of(TrialKind.BESIDE):
        beside = paper_tables.beside_rows(rows)
        svg = figures.coverage_curves(beside, beside[0]["noise"])
        made.append(("Section 5.3: the comprehensive room against time and energy", svg, ""))
    limits = results.of(TrialKind.LIMITS)
    if limits:
        made.append(("Lost coverage by cause", figures.loss_figure(limits), ""))
    for noise in results.levels:
        svg = figures.coverage_curves(results.of(TrialKind.RUN, TrialKind.LIMITS), noise)
        note = (
            "Mean over all runs, in multiples of the time or energy to sweep the sweepable area "
            "once, straight ahead at cruise speed. A level line: the planner has ended. A line "
            "that stops: a run has reached its time limit."
        )
        made.append((f"Coverage against time and energy, noise {noise}", svg, note))
    if results.of(TrialKind.ZIMABLUE) and compare_tables.shared(rows):
        note = "Each robot against its own reference time and path. Dashed: zimablue."
        made.append(("Comparison with zimablue", figures.zimablue_curves(rows), note))
    return made
