"""The report of one run: a self-contained HTML page, and a PNG."""

from __future__ import annotations

import os
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Any

from bridge.errors import OutputExistsError
from bridge.view.output import write
from bridge.view.report import figures
from bridge.view.report import tables as rows
from bridge.view.report.drawing import svg
from bridge.view.report.page import document, section, table
from bridge.view.report.png import picture
from bridge.view.report.run_data import load_run
from bridge.view.report.words import summary_sentences, tiles, title, when

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

    from bridge.view.report.run_data import RunData
    from bridge.view.report.tables import Hole

_WIDE = 6.6
"""Width of the figure of the room, inches."""


def write_report(
    log: Path, out: Path | None, *, png: Path | None = None, force: bool = False
) -> RunData:
    """Write a run's page, its picture, or both; return the data that was read.

    Raises:
        LogReadError: the log cannot be read.
        OutputExistsError: a file would be replaced and ``force`` is not set.
        LogWriteError: a file cannot be written.
        PlotMissingError: matplotlib is not installed.

    """
    for path in (out, png):
        if path is not None and path.is_file() and not force:
            raise OutputExistsError(path)
    data = load_run(log)
    found = rows.holes(data)
    if out is not None:
        # Parts of a name that are not valid UTF-8 become replacement characters.
        write(out, render(data, found).encode(errors="replace"))
    if png is not None:
        write(png, picture(data, found))
    return data


def render(data: RunData, found: list[Hole]) -> str:
    """Return the page as HTML."""
    parts = []
    if data.track.best:
        parts.append(
            section(
                "Room and path",
                svg(_WIDE, figures.room_height(data, _WIDE), _room(data, found)),
                _room_note(data),
            )
        )
    if data.coverage is not None:
        drawn = svg(7.6, 3.8, _coverage(data))
        parts.append(section("Coverage against time", drawn, _CURVE_NOTE))
        heading = "Comparison with the paper, the bounds and the reference"
        parts.append(table(heading, *rows.comparison(data)))
        parts.append(table("Unswept floor", *rows.hole_rows(found), note=_HOLE_NOTE))
    for heading, note, draw in figures.panels(data):
        parts.append(section(heading, svg(7.6, 2.8, partial(draw, data)), note))
    parts.append(table("Messages of the device", *rows.stream_rows(data), note=_STREAM_NOTE))
    parts.append(table("Faults and events", *rows.event_rows(data), note=rows.event_note(data)))
    parts.append(table("Settings", ("", ""), rows.settings(data)))
    lead = "".join(f"<p>{escape(line)}</p>" for line in summary_sentences(data))
    return document(title(data), when(data), lead, tiles(data), parts)


_CURVE_NOTE = (
    "Time starts with the first command to drive. The dashed line is the lower bound: always at "
    "top speed, and no floor swept twice. No run can be to the left of it."
)
_HOLE_NOTE = (
    "Unswept floor that the mouth could have reached. The radius is that of the largest disc that "
    "fits in the piece: slivers along a wall are long but thin."
)
_STREAM_NOTE = (
    "A gap is a pause of more than three periods of the default rate. Messages without a default "
    "rate are sent on occasion."
)


def _room(data: RunData, found: list[Hole]) -> Any:  # noqa: ANN401 - a drawing
    def draw(axes: Axes) -> None:
        figures.draw_room(axes, data)
        figures.draw_holes(axes, [(h.x_m, h.y_m, h.area_cm2, h.inradius_m) for h in found])

    return draw


def _coverage(data: RunData) -> Any:  # noqa: ANN401 - a drawing
    def draw(axes: Axes) -> None:
        share = rows.paper_share(data)
        figures.draw_coverage(axes, data)
        figures.draw_bounds(axes, data, share[0] if share else None)
        figures.finish_coverage(axes)

    return draw


def _room_note(data: RunData) -> str:
    basis = "the true path" if data.track.truth else "the estimated path"
    if data.coverage is None:
        return f"The figure shows {basis}."
    return (
        f"The swept floor follows {basis}. The numbers are those of the unswept pieces in the "
        "table below, largest first."
    )


def default_path(log: Path) -> Path:
    """Return the name of the log with the suffix ``.html``."""
    return log.with_suffix(os.extsep + "html")
