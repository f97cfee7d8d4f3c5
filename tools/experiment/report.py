"""One self-contained HTML page: tables, curves, paths."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from tools.experiment import figures, tables

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tools.experiment.store import Row
    from tools.experiment.tables import Table

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #22262b; max-width: 68rem; margin: 2rem auto;
  padding: 0 1rem; }
h1, h2 { font-weight: 600; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .5rem 0; }
th, td { padding: .25rem .7rem; border-bottom: 1px solid #e3e6ea; text-align: left; }
th { font-weight: 600; color: #555b63; font-size: .85em; vertical-align: bottom; }
.wide { overflow-x: auto; }
.note { color: #60666e; font-size: .9em; max-width: 50rem; }
.grid { display: grid; grid-template-columns: repeat(auto-fill, minmax(19rem, 1fr)); gap: 1rem; }
svg { max-width: 100%; height: auto; }
"""


def all_tables(rows: Sequence[Row]) -> list[Table]:
    """Every table that the rows have something for."""
    made = []
    if any(row["room"] in tables.PAPER_SHARES and row["planner"] == "paper" for row in rows):
        made.append(tables.paper_table(rows))
    made += [tables.planner_table(rows), tables.curve_table(rows), tables.energy_table(rows)]
    made += [tables.room_table(rows, noise) for noise in _levels(rows)]
    return made


def render(title: str, command: str, rows: Sequence[Row], extra: Sequence[tuple[str, str]]) -> str:
    """The page; ``extra`` are further figures, each with its heading."""
    parts = [
        f"<h1>{escape(title)}</h1>",
    ]
    parts.append(
        f'<p class="note">Made by <code>{escape(command)}</code>; equal seeds give equal '
        "figures. All coverage is measured from the truth.</p>"
    )
    parts += [_table(table) for table in all_tables(rows)]
    for noise in _levels(rows):
        parts.append(f"<h2>Coverage against time and energy, noise {escape(noise)}</h2>")
        parts.append(figures.coverage_curves(rows, noise))
    for heading, svg in extra:
        parts.append(f"<h2>{escape(heading)}</h2>{svg}")
    parts.append("<h2>Paths</h2>")
    parts.append('<p class="note">The first seed of each; dot: start, square: end.</p>')
    firsts = [runs[0] for runs in tables.group(rows, "room", "planner", "noise").values()]
    pictures = "".join(f"<div>{figures.path_picture(row)}</div>" for row in firsts)
    parts.append(f'<div class="grid">{pictures}</div>')
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>\n<body>{body}</body></html>\n"
    )


def _levels(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(row["noise"] for row in rows))


def _table(table: Table) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in table.head)
    lines = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows
    )
    note = f'<p class="note">{escape(table.note)}</p>' if table.note else ""
    return (
        f'<h2>{escape(table.title)}</h2><div class="wide"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{lines}</tbody></table></div>{note}"
    )
