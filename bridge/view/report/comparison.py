"""Comparison of two runs: metrics in one table, paths and curves in one picture."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

from bridge.view.output import write
from bridge.view.report import figures as report_figures
from bridge.view.report import words
from bridge.view.report.drawing import as_png, blank, drawn_text, floor_axes, nothing, svg
from bridge.view.report.page import document, section, table
from bridge.view.report.picture import draw_plan, plan_legend

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from matplotlib.axes import Axes

    from bridge.view.report.run_data import RunData

_COLOURS = (report_figures.BLUE, report_figures.ORANGE)
_PERCENT = (
    "coverage.mouth_sweepable",
    "coverage.mouth_passing",
    "coverage.mouth_free",
    "coverage.body_reachable",
    "coverage.body_free",
    "coverage.eq8",
    "repeat_ratio",
)
_POINTS = "Differences of shares are in percentage points: from 90 % to 91 % is +1 point."


def figures_of(data: RunData) -> dict[str, float | None]:
    """Return a run's metrics for the comparison."""
    measured = data.coverage
    made: dict[str, float | None] = {
        "duration_s": data.figure("duration_s"),
        "path_m": data.figure("path_m"),
        "turns": data.figure("turns"),
    }
    shares = measured.coverage.to_dict() if measured is not None else {}
    for name in (
        *("mouth_sweepable", "mouth_passing", "mouth_free"),
        *("body_reachable", "body_free", "eq8"),
    ):
        known = data.figure("coverage", name)
        made[f"coverage.{name}"] = known if known is not None else shares.get(name)
    for name in ("t90_s", "t99_s", "largest_hole_cm2", "hole_inradius_m", "repeat_ratio"):
        known = data.figure(name)
        made[name] = known if known is not None else getattr(measured, name, None)
    made |= {
        "time_ratio": measured.time_ratio if measured is not None else None,
        "collisions": data.figure("collisions"),
        "contact_s": data.figure("contact_s"),
        "energy_wh": data.figure("energy_wh"),
        "motor_wh": data.motor_wh,
        "pose_error_m.end": data.figure("pose_error_m", "end"),
        "pose_error_m.max": data.figure("pose_error_m", "max"),
        "frames_lost": float(data.lost) if data.link else None,
        "crc_errors": data.figure("wire", "crc_errors"),
        "clock_bound_ms": data.clock[-1][1] if data.clock else None,
        "events": float(len(data.happenings)),
    }
    return made


def compare(a: RunData, b: RunData) -> dict[str, Any]:
    """Return the metrics of both runs and their differences, second minus first, as JSON."""
    first, second = figures_of(a), figures_of(b)
    changed = {}
    for key, one in first.items():
        two = second[key]
        changed[key] = None if one is None or two is None else round(two - one, 6)
    return {
        "a": {"log": str(a.path), "title": words.title(a), **_named(a), "figures": first},
        "b": {"log": str(b.path), "title": words.title(b), **_named(b), "figures": second},
        "difference": changed,
    }


def violations(
    difference: Mapping[str, float | None],
    least: Mapping[str, float],
    most: Mapping[str, float],
) -> list[str]:
    """Return one line for each metric whose difference is not within its limits.

    A metric that one of the runs lacks is a violation.

    Args:
        difference: the differences of :func:`compare`.
        least: minimum difference by metric.
        most: maximum difference by metric.

    Raises:
        KeyError: a limit names a metric that does not exist.

    """
    lines = []
    for key, bound, word, sign in (
        *((key, low, "below", 1.0) for key, low in least.items()),
        *((key, high, "above", -1.0) for key, high in most.items()),
    ):
        change = difference[key]
        if change is None:
            lines.append(f"{key}: one of the runs does not have it")
        elif sign * change < sign * bound:
            lines.append(f"{key}: the difference {change:+g} is {word} {bound:+g}")
    return lines


def _named(data: RunData) -> dict[str, Any]:
    return {"outcome": data.summary.get("outcome"), "whole": data.whole}


def rows(a: RunData, b: RunData) -> list[tuple[str, ...]]:
    """Return the rows of the table: metric, first run, second run, difference.

    Metrics that both runs lack are omitted.
    """
    first, second = figures_of(a), figures_of(b)
    lines: list[tuple[str, ...]] = [
        (
            "outcome",
            str(a.summary.get("outcome") or "unknown"),
            str(b.summary.get("outcome") or "unknown"),
            "",
        )
    ]
    for key, one in first.items():
        two = second[key]
        if one is None and two is None:
            continue
        delta = "" if one is None or two is None else _form(key, two - one, sign=True)
        lines.append((_label(key), _form(key, one), _form(key, two), delta))
    return lines


def _label(key: str) -> str:
    name, _, unit = key.rpartition("_")
    if unit in {"s", "m", "wh", "cm2", "ms"}:
        unit = {"wh": "Wh", "cm2": "cm²"}.get(unit, unit)
        return f"{name.replace('.', ' ').replace('_', ' ')}, {unit}"
    return key.replace(".", " ").replace("_", " ")


def _form(key: str, value: float | None, *, sign: bool = False) -> str:
    if value is None:
        return "unknown"
    plus = "+" if sign else ""
    if key in _PERCENT:
        return f"{100 * value:{plus}.2f} {'points' if sign else '%'}"
    if float(value).is_integer():
        return f"{value:{plus}.0f}"
    return f"{value:{plus}.4g}" if abs(value) < 1 else f"{value:{plus}.2f}"


def write_page(a: RunData, b: RunData, out: Path) -> None:
    """Write the comparison as a page, or as a picture if ``out`` ends with ``.png``.

    Raises:
        LogWriteError: the file cannot be written.
        PlotMissingError: matplotlib is not installed.

    """
    is_picture = out.suffix.lower() == ".png"
    write(out, picture(a, b) if is_picture else render(a, b).encode(errors="replace"))


def render(a: RunData, b: RunData) -> str:
    """Return the page as HTML."""
    runs = (a, b)
    parts = [table("Figures", ("", "A", "B", "B minus A"), rows(a, b), note=_POINTS)]
    if any(run.track.best for run in runs):
        note = "Both paths are drawn in the room of A, even if B ran in another room."
        parts.append(section("Paths", svg(6.6, 7.0, lambda axes: _paths(axes, a, b)), note))
    if any(run.coverage is not None for run in runs):
        parts.append(
            section(
                "Coverage against time",
                svg(7.6, 3.8, lambda axes: _curves(axes, a, b)),
            )
        )
    lead = f"<p><b>A</b>: {escape(words.title(a))}, {escape(words.when(a))}.</p>"
    lead += f"<p><b>B</b>: {escape(words.title(b))}, {escape(words.when(b))}.</p>"
    return document("Two runs compared", f"{a.path.name} and {b.path.name}", lead, [], parts)


def picture(a: RunData, b: RunData) -> bytes:
    """Return paths and curves as a PNG."""
    figure = blank(14.0, 6.6)
    left, right = figure.subplots(1, 2)
    if any(run.track.best for run in (a, b)):
        _paths(left, a, b)
    else:
        nothing(left, "neither log contains poses")
    if any(run.coverage is not None for run in (a, b)):
        _curves(right, a, b)
    else:
        nothing(right, "the coverage of both runs is unknown")
    titles = f"A: {words.title(a)}      B: {words.title(b)}"
    figure.suptitle(drawn_text(titles), fontsize=10)
    return as_png(figure)


def _paths(axes: Axes, a: RunData, b: RunData) -> None:
    plan = a.track.plan or b.track.plan
    if plan is not None:
        draw_plan(axes, plan, obstacles="#c9ced6")
    for name, run, colour in zip("AB", (a, b), _COLOURS, strict=True):
        poses = [pose for _, pose in run.track.best]
        if poses:
            xs, ys = [p.x_m for p in poses], [p.y_m for p in poses]
            label = drawn_text(f"{name}: {run.track.name}")
            axes.plot(xs, ys, color=colour, lw=1.0, alpha=0.85, label=label)
            axes.plot(xs[-1], ys[-1], "s", color=colour, mec="white", ms=8)
    floor_axes(axes)
    lines, _ = axes.get_legend_handles_labels()
    axes.legend(
        handles=[*lines, *plan_legend(plan)],
        frameon=False,
        fontsize=8,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=2,
    )


def _curves(axes: Axes, a: RunData, b: RunData) -> None:
    for name, run, colour in zip("AB", (a, b), _COLOURS, strict=True):
        if run.coverage is not None:
            label = drawn_text(f"{name}: {run.track.name}")
            report_figures.draw_coverage(axes, run, colour=colour, label=label)
    report_figures.finish_coverage(axes)
