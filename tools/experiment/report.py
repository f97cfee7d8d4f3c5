"""One self-contained HTML page: tables, curves, paths. And the tables as Markdown."""

from __future__ import annotations

import re
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from tools.cli.options import DEFAULT_PLANNER
from tools.experiment import compare_tables, figures, layout_tables, paper_tables, tables
from tools.experiment.paired import paired_table
from tools.experiment.trials import Kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tools.experiment.store import Row
    from tools.experiment.tables import Table

_STYLE = """
:root { --ink: #20262c; --soft: #5d6670; --line: #e4e8ec; --accent: #1f4e79; }
* { box-sizing: border-box; }
body { font: 15px/1.55 system-ui, -apple-system, "Segoe UI", sans-serif; color: var(--ink);
  background: #f5f7f9; margin: 0; -webkit-text-size-adjust: 100%; }
header, main { max-width: 72rem; margin: 0 auto; padding: 0 1rem; }
header { padding-top: 2rem; padding-bottom: .5rem; }
h1 { font-size: 1.7rem; margin: 0 0 .3rem; } h2 { font-size: 1.1rem; margin: 0 0 .6rem; }
section { background: #fff; border: 1px solid var(--line); border-radius: .6rem;
  padding: 1rem 1.2rem; margin: 1rem 0; }
.facts { display: flex; flex-wrap: wrap; gap: .4rem 1.6rem; margin: .8rem 0 0; padding: 0;
  list-style: none; color: var(--soft); } .facts b { color: var(--ink); font-weight: 600; }
code { font: .88em/1.4 ui-monospace, Menlo, Consolas, monospace; background: #eef1f4;
  border-radius: .25rem; padding: .1em .35em; }
.wide { overflow-x: auto; -webkit-overflow-scrolling: touch; margin: 0 -.2rem; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .93em; }
th, td { padding: .32rem .6rem; border-bottom: 1px solid var(--line); text-align: left;
  white-space: nowrap; }
th { font-weight: 600; color: var(--soft); font-size: .85em; vertical-align: bottom;
  white-space: normal; min-width: 3.2rem; border-bottom: 2px solid var(--line); }
td.n, th.n { text-align: right; } tbody tr:hover td { background: #f3f6fa; }
th:first-child, td:first-child { position: sticky; left: 0; background: #fff; }
td.long { white-space: normal; min-width: 13rem; }
.note { color: var(--soft); font-size: .88em; max-width: 54rem; margin: .6rem 0 0; }
.grid { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fill, minmax(min(17rem, 100%), 1fr)); }
.figure svg { display: block; width: 100%; height: auto; max-width: 56rem; }
.grid svg { display: block; width: 100%; height: auto; }
@media (max-width: 40rem) {
  section { padding: .8rem .7rem; border-radius: 0; margin: .7rem -1rem; border-width: 1px 0; }
  h1 { font-size: 1.35rem; } .figure { overflow-x: auto; } .figure svg { min-width: 36rem; }
}
@media print { body { background: #fff; } section { break-inside: avoid; border: 0; } }
"""
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?( %)?$|-$|$")
_LONG = 28
"""Letters from which a cell may break its line."""


@dataclass(frozen=True, slots=True)
class Results:
    """The rows of an experiment, by kind."""

    rows: Sequence[Row]

    def of(self, *kinds: Kind) -> list[Row]:
        """The rows of some kinds."""
        return [row for row in self.rows if row["kind"] in kinds]

    @property
    def levels(self) -> list[str]:
        """Noise levels of our planners' runs, in order of first sight."""
        return list(dict.fromkeys(row["noise"] for row in self.of(Kind.RUN, Kind.LIMITS)))


def all_tables(rows: Sequence[Row], rooms_folder: str) -> list[Table]:
    """Every table that the rows have something for."""
    results = Results(rows)
    runs, cycles, limits = results.of(Kind.RUN), results.of(Kind.CYCLES), results.of(Kind.LIMITS)
    made = []
    if any(row["room"] in paper_tables.PAPER_SHARES and row["planner"] == "paper" for row in runs):
        made.append(paper_tables.paper_table(runs))
    if results.of(Kind.BESIDE):
        made.append(paper_tables.beside_table(rows))
    if results.of(Kind.LAYOUT):
        made.append(layout_tables.layout_table(rows))
    if results.of(Kind.RANGES):
        made.append(layout_tables.range_table(rows))
    if cycles:
        made.append(paper_tables.cycle_table(cycles))
    if limits:
        made.append(compare_tables.limit_table(limits))
        made += [compare_tables.limit_room_table(limits, noise) for noise in results.levels]
    ours = runs + limits
    if ours:
        made.append(tables.planner_table(ours))
        made += [tables.curve_table(ours, curve) for curve in ("coverage", "by_energy")]
        swept = ours + results.of(Kind.ZIMABLUE)
        paired = [
            paired_table(swept, curve, DEFAULT_PLANNER) for curve in ("coverage", "by_energy")
        ]
        made += [table for table in paired if table.rows]
    if compare_tables.shared(rows) and results.of(Kind.ZIMABLUE):
        made += [compare_tables.zimablue_table(rows, curve) for curve in ("coverage", "by_path")]
    if ours:
        made.append(tables.energy_table(ours))
        made += [tables.room_table(ours, noise) for noise in results.levels]
        made.append(tables.worst_table(ours, rooms_folder))
    return made


def render(title: str, command: str, rows: Sequence[Row], made: Sequence[Table]) -> str:
    """The page, from its tables and what figures the rows give."""
    facts = [
        ("runs", len(rows)),
        ("rooms", len({row["room"] for row in rows})),
        ("planners", len({row["planner"] for row in rows})),
        ("seeds", len({row["seed"] for row in rows})),
    ]
    listed = "".join(f"<li><b>{count}</b> {escape(name)}</li>" for name, count in facts)
    parts = [_figure(heading, svg, note) for heading, svg, note in _figures(rows)]
    parts += [_table(table) for table in made]
    firsts = [
        runs[0]
        for runs in tables.group(rows, "room", "planner", "noise").values()
        if runs[0].get("path") and runs[0]["kind"] != Kind.RANGES
    ]
    if firsts:
        pictures = "".join(f"<div>{figures.path_picture(row)}</div>" for row in firsts)
        parts.append(
            '<section><h2>Paths</h2><p class="note">The first seed of each; a dot: the start, '
            f'a square: the end.</p><div class="grid">{pictures}</div></section>'
        )
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>\n<body>"
        f'<header><h1>{escape(title)}</h1><p class="note">Made by <code>{escape(command)}</code>; '
        "equal seeds give equal figures. All coverage is measured from the truth.</p>"
        f'<ul class="facts">{listed}</ul></header>\n<main>{body}</main></body></html>\n'
    )


def markdown(made: Sequence[Table]) -> str:
    """The tables, to be kept in a repository."""
    parts = []
    for table in made:
        parts += [f"## {table.title}", "", _line(table.head), _line(["---"] * len(table.head))]
        parts += [_line(row) for row in table.rows]
        parts += ["", *([table.note, ""] if table.note else [])]
    return "\n".join(parts)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _figures(rows: Sequence[Row]) -> list[tuple[str, str, str]]:
    """Heading, picture and note of each."""
    results = Results(rows)
    made = []
    cycles = results.of(Kind.CYCLES)
    if any(row["offsets"] for row in cycles):
        note = "Seven U-shaped cycles at noise paper, on an open floor; each grey line is a seed."
        made.append(("Fig. 15: keeping the path", figures.cycles_figure(cycles), note))
    for row in cycles:
        if row.get("smoothing"):
            note = "Seed 0 of the same runs, its first seconds, as commanded at 50 Hz."
            made.append(("Fig. 12: velocity smoothing", figures.smoothing_figure(row), note))
    if results.of(Kind.BESIDE):
        beside = paper_tables.beside_rows(rows)
        svg = figures.coverage_curves(beside, beside[0]["noise"])
        made.append(("Section 5.3: the comprehensive room against time and energy", svg, ""))
    limits = results.of(Kind.LIMITS)
    if limits:
        made.append(("The loss by cause", figures.loss_figure(limits), ""))
    for noise in results.levels:
        svg = figures.coverage_curves(results.of(Kind.RUN, Kind.LIMITS), noise)
        note = (
            "Mean over all runs, in multiples of what it takes to sweep the sweepable area once, "
            "straight on at cruise speed. Level: its planner has ended; a line that stops: a run "
            "was ended by time."
        )
        made.append((f"Coverage against time and energy, noise {noise}", svg, note))
    if results.of(Kind.ZIMABLUE) and compare_tables.shared(rows):
        note = "Each robot against its own reference time and path; dashed: zimablue's."
        made.append(("Side by side with zimablue", figures.zimablue_curves(rows), note))
    return made


def _figure(heading: str, svg: str, note: str) -> str:
    text = f'<p class="note">{escape(note)}</p>' if note else ""
    return f'<section><h2>{escape(heading)}</h2><div class="figure">{svg}</div>{text}</section>'


def _table(table: Table) -> str:
    columns = list(zip(*table.rows, strict=True)) if table.rows else [()] * len(table.head)
    numeric = [bool(column) and all(_NUMBER.match(cell) for cell in column) for column in columns]
    kinds = [' class="n"' if number else "" for number in numeric]
    head = "".join(
        f"<th{kind}>{escape(cell)}</th>" for cell, kind in zip(table.head, kinds, strict=True)
    )
    lines = "".join(
        "<tr>" + "".join(_cell(cell, kind) for cell, kind in zip(row, kinds, strict=True)) + "</tr>"
        for row in table.rows
    )
    note = f'<p class="note">{escape(table.note)}</p>' if table.note else ""
    return (
        f'<section><h2>{escape(table.title)}</h2><div class="wide"><table><thead><tr>{head}</tr>'
        f"</thead><tbody>{lines}</tbody></table></div>{note}</section>"
    )


def _cell(text: str, kind: str) -> str:
    if text.startswith("sweepctl "):
        return f"<td><code>{escape(text)}</code></td>"
    if not kind and len(text) > _LONG:
        kind = ' class="long"'
    return f"<td{kind}>{escape(text)}</td>"
