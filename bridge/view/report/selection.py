"""Comparison of many runs by groups, in one table and as distributions."""

from __future__ import annotations

import statistics
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

from bridge.library.columns import number_cell
from bridge.view.report.drawing import as_png, blank, drawn_text, svg, tidy
from bridge.view.report.figures import BLUE, INK
from bridge.view.report.page import Tile, document, gallery, table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

Row = dict[str, Any]
"""A run's values by the library's column names."""
_NONE = "(none)"
_MAX_ROWS = 500
"""Maximum number of runs that a page lists. The table of groups covers all runs."""
_MAX_GROUPS = 40
"""Maximum number of groups that a picture can show."""
_JITTER = 0.16
"""Half of the width over which a group's points are spread, relative to the group spacing."""


class ComparedColumn(NamedTuple):
    """A column that is compared."""

    column: str
    short: str
    """Heading of a table column."""
    text: str
    """Label of an axis."""
    factor: float = 1.0
    form: str = "{:.1f}"


MEASURES = (
    ComparedColumn("coverage", "swept, %", "swept of the sweepable floor, %", 100.0, "{:.2f}"),
    ComparedColumn("duration_s", "time, s", "time, s", form="{:.0f}"),
    ComparedColumn("path_m", "path, m", "path, m"),
    ComparedColumn("collisions", "collisions", "collisions", form="{:.0f}"),
    ComparedColumn("largest_hole_cm2", "hole, cm²", "largest hole, cm²", form="{:.0f}"),
    ComparedColumn("energy_wh", "energy, Wh", "energy, Wh", form="{:.2f}"),
    ComparedColumn("supervision", "events", "supervision events", form="{:.0f}"),
    ComparedColumn("lost", "lost", "lost frames", form="{:.0f}"),
)
_DRAWN = MEASURES[:4]


class Group(NamedTuple):
    """The runs with equal values in the column by which they are grouped."""

    name: str
    rows: list[Row]

    def values(self, measure: ComparedColumn) -> list[float]:
        """Return the known values in the unit of the measure."""
        found = (row[measure.column] for row in self.rows)
        return [value * measure.factor for value in found if value is not None]


def grouped(rows: Sequence[Row], by: str) -> list[Group]:
    """Return the groups, sorted by their value. Runs without a value are last."""
    groups: dict[Any, list[Row]] = {}
    for row in rows:
        groups.setdefault(row[by], []).append(row)
    keys = sorted(groups, key=lambda key: (key is None, isinstance(key, str), key or 0))
    return [Group(_NONE if key is None else str(key), groups[key]) for key in keys]


def groups_json(groups: Sequence[Group], by: str) -> dict[str, Any]:
    """Return the groups' results in the columns' own units as values for JSON."""
    found = []
    for group in groups:
        figures = {}
        for measure in MEASURES:
            values = [value / measure.factor for value in group.values(measure)]
            spread = values and {
                "runs": len(values),
                "median": round(statistics.median(values), 6),
                "mean": round(statistics.fmean(values), 6),
                "min": round(min(values), 6),
                "max": round(max(values), 6),
            }
            figures[measure.column] = spread or None
        outcomes: dict[str, int] = {}
        for row in group.rows:
            name = row["outcome"] or "unknown"
            outcomes[name] = outcomes.get(name, 0) + 1
        found.append(
            {"name": group.name, "runs": len(group.rows), "outcomes": outcomes, "figures": figures}
        )
    return {"by": by, "groups": found}


def group_rows(groups: Sequence[Group], by: str) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return headings and rows of the table: medians, and the range of the coverage."""
    head = (by, "runs", "complete", *(m.short for m in MEASURES), "worst, %")
    lines = []
    for group in groups:
        complete = sum(row["outcome"] == "complete" for row in group.rows)
        cells = [group.name, str(len(group.rows)), str(complete)]
        for measure in MEASURES:
            values = group.values(measure)
            cells.append(measure.form.format(statistics.median(values)) if values else "-")
        coverage = group.values(MEASURES[0])
        lines.append((*cells, f"{min(coverage):.2f}" if coverage else "-"))
    return head, lines


def comparison_page(groups: Sequence[Group], by: str, what: str) -> str:
    """Return the page.

    Args:
        groups: Runs in groups.
        by: Column by which they are grouped.
        what: The selection in words.

    Raises:
        PlotMissingError: matplotlib is not installed.

    """
    rows = [row for group in groups for row in group.rows]
    parts = [
        table(
            f"By {by}",
            *group_rows(groups, by),
            note="Medians of the known values; worst: the least swept. events: of the supervision.",
        )
    ]
    drawn = [m for m in _DRAWN if any(group.values(m) for group in groups)]
    if drawn:
        pictures = [
            svg(5.6, _height(groups), lambda axes, m=measure: _draw(axes, groups, m))  # type: ignore[misc]  # mypy cannot infer a lambda with a default
            for measure in drawn
        ]
        note = "Each point is a run, the line is the median."
        parts.append(gallery("Spread", pictures, note))
    head = ("date", "room", "planner", "seed", "outcome", "swept, %", "time, s", "path, m", "log")
    listed = [_cells(row) for row in rows[-_MAX_ROWS:]]
    left_out = len(rows) - len(listed)
    note = f"The newest {len(listed)} of {len(rows)} runs." if left_out else ""
    parts.append(table("Runs", head, listed, note=note))
    coverage = [row["coverage"] for row in rows if row["coverage"] is not None]
    tiles = [Tile(str(len(rows)), "runs"), Tile(str(len(groups)), f"groups, by {by}")]
    if coverage:
        middle = f"{100 * statistics.median(coverage):.2f} %"
        tiles.append(Tile(middle, "swept of what the mouth can reach, median"))
        tiles.append(Tile(f"{100 * min(coverage):.2f} %", "swept in the worst run"))
    lead = f"<p>{escape(what)}</p>"
    count = f"{len(rows)} run{'' if len(rows) == 1 else 's'}"
    return document("Runs compared", count, lead, tiles, parts)


def comparison_picture(groups: Sequence[Group]) -> bytes:
    """Return the distribution of the coverage as a PNG.

    Raises:
        PlotMissingError: matplotlib is not installed.

    """
    drawn = [m for m in _DRAWN if any(group.values(m) for group in groups)] or [_DRAWN[0]]
    figure = blank(5.6 * min(2, len(drawn)), _height(groups) * ((len(drawn) + 1) // 2))
    places = figure.subplots((len(drawn) + 1) // 2, min(2, len(drawn)), squeeze=False).ravel()
    for axes, measure in zip(places, drawn, strict=False):
        _draw(axes, groups, measure)
    for axes in places[len(drawn) :]:
        axes.set_axis_off()
    count = sum(len(group.rows) for group in groups)
    figure.suptitle(
        f"{count} run{'' if count == 1 else 's'}: each point is a run, the line is the median",
        fontsize=10,
        x=0.01,
        ha="left",
    )
    return as_png(figure)


def _height(groups: Sequence[Group]) -> float:
    return 1.4 + 0.42 * min(len(groups), _MAX_GROUPS)


def _draw(axes: Axes, groups: Sequence[Group], measure: ComparedColumn) -> None:
    """Draw a row for each group, the first on top."""
    shown = groups[:_MAX_GROUPS]
    for place, group in enumerate(shown):
        values = group.values(measure)
        if not values:
            continue
        # The spread is regular, not random, so that equal runs give equal pictures.
        steps = [_JITTER * (2 * ((i * 7919) % 101) / 100 - 1) for i in range(len(values))]
        spots = [place + step for step in steps]
        axes.plot(values, spots, "o", ms=4.5, mfc=BLUE, mec="white", mew=0.5, alpha=0.75)
        middle = statistics.median(values)
        axes.plot([middle, middle], [place - 0.3, place + 0.3], color=INK, lw=2.0, zorder=1)
    axes.set_yticks(range(len(shown)), [drawn_text(group.name) for group in shown])
    axes.set_ylim(len(shown) - 0.5, -0.5)
    axes.set_xlabel(measure.text)
    tidy(axes)


def _cells(row: Row) -> tuple[str, ...]:
    return (
        *(str(row[name]) if row[name] is not None else "-" for name in ("date", "room", "planner")),
        number_cell(row, "seed", "{:.0f}"),
        row["outcome"] or "-",
        number_cell(row, "coverage", "{:.2f}", 100.0),
        number_cell(row, "duration_s", "{:.0f}"),
        number_cell(row, "path_m", "{:.1f}"),
        row["log"],
    )
