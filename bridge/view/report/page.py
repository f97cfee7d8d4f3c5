"""Self-contained HTML pages: style, tiles, tables and figures."""

from __future__ import annotations

import re
from html import escape
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

_STYLE = """
:root { --ink: #20262c; --soft: #5d6670; --line: #e4e8ec; --accent: #1f4e79; }
* { box-sizing: border-box; }
body { font: 15px/1.55 system-ui, -apple-system, "Segoe UI", sans-serif; color: var(--ink);
  background: #f5f7f9; margin: 0; }
header, main { max-width: 66rem; margin: 0 auto; padding: 0 1rem; }
header { padding-top: 2rem; }
h1 { font-size: 1.7rem; margin: 0; } h2 { font-size: 1.1rem; margin: 0 0 .6rem; }
.when { color: var(--soft); margin: .2rem 0 1rem; } .lead p { margin: .3rem 0; max-width: 48rem; }
section { background: #fff; border: 1px solid var(--line); border-radius: .6rem;
  padding: 1rem 1.2rem; margin: 1rem 0; }
.tiles { display: grid; gap: .7rem; margin: 1.2rem 0;
  grid-template-columns: repeat(auto-fill, minmax(9.5rem, 1fr)); }
.tile { background: #fff; border: 1px solid var(--line); border-left: 4px solid #b9c2cc;
  border-radius: .5rem; padding: .6rem .8rem; }
.tile b { display: block; font-size: 1.35rem; font-variant-numeric: tabular-nums; }
.tile span { color: var(--soft); font-size: .84rem; line-height: 1.3; display: block; }
.good { border-left-color: #3f8f5f; } .fair { border-left-color: #e0a52e; }
.bad { border-left-color: #c0504d; }
code { font: .88em/1.4 ui-monospace, Menlo, Consolas, monospace; background: #eef1f4;
  border-radius: .25rem; padding: .1em .35em; }
.wide { overflow-x: auto; } svg { display: block; width: 100%; height: auto; }
.figure svg { max-width: 58rem; }
.grid { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fill, minmax(min(17rem, 100%), 1fr)); }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .93em; }
th, td { padding: .32rem .7rem; border-bottom: 1px solid var(--line); text-align: left;
  vertical-align: top; white-space: nowrap; }
td.long { white-space: normal; min-width: 13rem; }
th { white-space: normal; font-weight: 600; color: var(--soft); font-size: .85em;
  border-bottom-width: 2px; }
td.n, th.n { text-align: right; } tbody tr:hover td { background: #f3f6fa; }
th:first-child, td:first-child { position: sticky; left: 0; background: #fff; }
tr.warning td { background: #fdf6e7; } tr.error td { background: #fbeceb; }
tr.debug td { color: var(--soft); }
.note { color: var(--soft); font-size: .88em; max-width: 48rem; margin: .6rem 0 0; }
footer { color: var(--soft); font-size: .85em; max-width: 66rem; margin: 0 auto 2rem;
  padding: 0 1rem; }
@media (max-width: 40rem) { section { border-radius: 0; margin: .7rem -1rem; } }
@media print { body { background: #fff; } section { break-inside: avoid; border: 0; } }
"""
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?( %)?$|-$|$")
_LONG = 28
"""Maximum length of a text that a table cell shows on one line, characters. A longer text wraps."""
_SEVERITIES = {"debug", "info", "warning", "error"}


class Tile(NamedTuple):
    """A highlighted value at the top of the page."""

    value: str
    meaning: str
    mood: str = ""
    """``good``, ``fair``, ``bad`` or none."""


def document(title: str, when: str, lead: str, tiles: Sequence[Tile], parts: Sequence[str]) -> str:
    """Return the whole page. ``lead`` and ``parts`` are HTML, everything else is plain text."""
    shown = "".join(
        f'<div class="tile {tile.mood}"><b>{escape(tile.value)}</b>'
        f"<span>{escape(tile.meaning)}</span></div>"
        for tile in tiles
    )
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>\n<body>"
        f'<header><h1>{escape(title)}</h1><p class="when">{escape(when)}</p>'
        f'<div class="lead">{lead}</div><div class="tiles">{shown}</div></header>\n'
        f"<main>{body}</main></body></html>\n"
    )


def section(heading: str, svg: str, note: str = "") -> str:
    """Return a figure with a heading and a note."""
    return (
        f'<section><h2>{escape(heading)}</h2><div class="figure">{svg}</div>{_note(note)}</section>'
    )


def gallery(heading: str, svgs: Sequence[str], note: str = "") -> str:
    """Return small figures side by side."""
    pictures = "".join(f"<div>{svg}</div>" for svg in svgs)
    return (
        f"<section><h2>{escape(heading)}</h2>{_note(note)}"
        f'<div class="grid">{pictures}</div></section>'
    )


def table(
    heading: str, head: Sequence[str], rows: Sequence[Sequence[str]], *, note: str = ""
) -> str:
    """Return a table with a heading; columns of numbers are right-aligned."""
    if not rows:
        return f"<section><h2>{escape(heading)}</h2><p>None.</p>{_note(note)}</section>"
    columns = list(zip(*rows, strict=True))
    kinds = [
        ' class="n"' if any(column) and all(map(_NUMBER.match, column)) else ""
        for column in columns
    ]
    top = "".join(f"<th{kind}>{escape(cell)}</th>" for cell, kind in zip(head, kinds, strict=True))
    top = f"<thead><tr>{top}</tr></thead>" if any(head) else ""
    lines = []
    for row in rows:
        severity = next((cell for cell in row if cell in _SEVERITIES), "")
        cells = "".join(_cell(cell, kind) for cell, kind in zip(row, kinds, strict=True))
        lines.append(f'<tr class="{severity}">{cells}</tr>' if severity else f"<tr>{cells}</tr>")
    return (
        f'<section><h2>{escape(heading)}</h2><div class="wide"><table>{top}'
        f"<tbody>{''.join(lines)}</tbody></table></div>{_note(note)}</section>"
    )


def _cell(text: str, kind: str) -> str:
    if text.startswith("sweepctl "):
        return f"<td><code>{escape(text)}</code></td>"
    if not kind and len(text) > _LONG:
        kind = ' class="long"'
    return f"<td{kind}>{escape(text)}</td>"


def _note(note: str) -> str:
    return f'<p class="note">{escape(note)}</p>' if note else ""
