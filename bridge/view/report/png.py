"""The report of a run as one picture."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from bridge.view.report import figures as report_figures
from bridge.view.report import tables as report_tables
from bridge.view.report import words
from bridge.view.report.drawing import as_png, blank, drawn_text, nothing

if TYPE_CHECKING:
    from bridge.view.report.run_data import RunData
    from bridge.view.report.tables import Hole

_WIDTH, _HEIGHT = 14.0, 10.0
_HEAD = 0.16
"""Share of the picture's height for the title and the summary."""
_BAND = 0.55
"""Maximum ratio of a room's height to its width for a drawing over the whole width."""
_LETTERS = 165


def picture(data: RunData, found: list[Hole]) -> bytes:
    """Draw the room, the coverage curve and the other plots side by side; return the PNG.

    Raises:
        PlotMissingError: matplotlib is not installed.

    """
    panels = report_figures.panels(data)[:3]
    figure = blank(_WIDTH, _HEIGHT)
    heights = [_HEAD, 1.0 - _HEAD]
    top, below = figure.subfigures(2, 1, height_ratios=heights, squeeze=False)[:, 0]
    top.text(0.012, 0.93, drawn_text(words.title(data)), fontsize=17, weight="bold", va="top")
    text = " ".join([f"{words.when(data)}.", *words.summary_sentences(data)])
    lines = "\n".join(textwrap.wrap(text, _LETTERS))
    top.text(0.012, 0.66, drawn_text(lines), fontsize=10, va="top", linespacing=1.5)
    is_band = bool(data.track.best) and report_figures.room_ratio(data) < _BAND
    if is_band:
        band = report_figures.room_height(data, _WIDTH) / _HEIGHT
        heights = [band, 1.0 - _HEAD - band]
        left, right = below.subfigures(2, 1, height_ratios=heights, squeeze=False)[:, 0]
    else:
        left, right = below.subfigures(1, 2, squeeze=False)[0]
    room = left.add_subplot()
    if data.track.best:
        report_figures.draw_room(room, data)
        marks = [(h.x_m, h.y_m, h.area_cm2, h.inradius_m) for h in found]
        report_figures.draw_holes(room, marks)
    else:
        nothing(room, "the log contains no poses")
    heights = [3, 7] if is_band else [2, 8]
    tiles, plots = right.subfigures(2, 1, height_ratios=heights, squeeze=False)[:, 0]
    for index, tile in enumerate(words.tiles(data)[:8]):
        x, y = 0.03 + 0.245 * (index % 4), 0.95 - 0.5 * (index // 4)
        tiles.text(x, y, tile.value, fontsize=14, weight="bold", va="top")
        meaning = "\n".join(textwrap.wrap(tile.meaning, 25))
        tiles.text(x, y - 0.19, meaning, fontsize=7.5, va="top", color=report_figures.SOFT)
    count = len(panels) + (data.coverage is not None)
    if count:
        if is_band:
            axes = plots.subplots(1, count, squeeze=False, width_ratios=_shares(count, data))[0]
        else:
            axes = plots.subplots(count, 1, squeeze=False, height_ratios=_shares(count, data))[:, 0]
        at = 0
        if data.coverage is not None:
            share = report_tables.paper_share(data)
            report_figures.draw_coverage(axes[0], data)
            report_figures.draw_bounds(axes[0], data, share[0] if share else None)
            report_figures.finish_coverage(axes[0])
            at = 1
        for axis, (_, _, draw) in zip(axes[at:], panels, strict=True):
            draw(data, axis)
    return as_png(figure)


def _shares(count: int, data: RunData) -> list[float]:
    """Give the coverage curve twice the space of the other plots."""
    return [2.0, *[1.0] * (count - 1)] if data.coverage is not None else [1.0] * count
