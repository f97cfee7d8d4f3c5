"""The rows of a report's tables, and the unswept pieces of floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

if TYPE_CHECKING:
    from bridge.view.report.run_data import LoggedEvent, RunData

Row = tuple[str, ...]
Rows = tuple[Row, list[Row]]
"""Column headings and rows."""

PAPER_SHARES = {
    "case-1": (0.9466, "Table 2, mean of five tests by division"),
    "case-2": (0.94, "section 5.2: “fluctuated around 94 %”"),
    "comprehensive": (0.9461, "section 5.3"),
}
"""The paper's coverage and its source. The paper's eq. 9 divides the area that the footprint has
covered by the free floor's area."""
_HOLES = 8
"""Maximum number of unswept pieces of floor in the table."""
_MIN_HOLE_CM2 = 1.0
"""Minimum area of an unswept piece in the table, cm²."""
_MAX_EVENTS = 200
"""Maximum number of events in the table."""
_KEYS = ("version", "port", "noise", "firmware", "uid", "boot_id", "reset_cause")


@dataclass(frozen=True, slots=True)
class Hole:
    """An unswept piece of sweepable floor."""

    x_m: float
    y_m: float
    area_cm2: float
    inradius_m: float


def holes(data: RunData) -> list[Hole]:
    """Return the largest unswept pieces, largest first."""
    report, meter = data.coverage, data.meter
    if report is None or meter is None:
        return []
    left = meter.regions.sweepable & ~np.isfinite(report.first_swept_s)
    labels, count = ndimage.label(left)
    if not count:
        return []
    cell_cm2 = report.resolution_m**2 * 1e4
    areas = np.bincount(labels.ravel(), minlength=count + 1)[1:] * cell_cm2
    depth = ndimage.distance_transform_edt(np.pad(left, 1))[1:-1, 1:-1]
    found = []
    for index in np.argsort(-areas)[:_HOLES]:
        if areas[index] < _MIN_HOLE_CM2:
            break
        own = np.where(labels == index + 1, depth, 0.0)
        row, column = np.unravel_index(int(own.argmax()), own.shape)
        x0, y0 = report.origin_m
        size = report.resolution_m
        inradius_m = max(float(own.max()) - 0.5, 0.0) * size
        found.append(
            Hole(
                x0 + (int(column) + 0.5) * size,
                y0 + (int(row) + 0.5) * size,
                float(areas[index]),
                inradius_m,
            )
        )
    return found


def paper_share(data: RunData) -> tuple[float, str] | None:
    """Return the paper's coverage for this room and its source; None: not in the paper."""
    return PAPER_SHARES.get(str(data.summary.get("room")))


def comparison(data: RunData) -> Rows:
    """Compare the run with the paper, the lower bound and the reference time."""
    report = data.coverage
    assert report is not None  # noqa: S101 - asked by the caller
    share = paper_share(data)
    eq8 = data.figure("coverage", "eq8")
    rows: list[Row] = [
        (
            "floor under the footprint (eq. 9)",
            f"{100 * report.coverage.body_free:.2f} %",
            f"{100 * share[0]:.2f} % ({share[1]})" if share else "not in the paper",
            "100 %",
        ),
        (
            "swept, of the sweepable floor",
            f"{100 * report.coverage.mouth_sweepable:.2f} %",
            "not given",
            "100 %",
        ),
        (
            "swept, of the floor reached in passing",
            f"{100 * report.coverage.mouth_passing:.2f} %",
            "not given",
            "100 %",
        ),
        (
            "swept, of the whole floor",
            f"{100 * report.coverage.mouth_free:.2f} %",
            "not given",
            f"{100 * report.sweepable_m2 / report.free_m2:.1f} % (corners are out of reach)",
        ),
        (
            "lane lengths (eq. 8)",
            "unknown" if eq8 is None else f"{100 * eq8:.2f} %",
            "not given",
            "100 %",
        ),
        (
            "time",
            f"{report.duration_s:.0f} s",
            "not given",
            (
                f"bound {report.min_time_s:.0f} s at top speed, "
                f"reference {report.reference_time_s:.0f} s at cruise speed"
            ),
        ),
        (
            "path",
            f"{report.path_m:.1f} m",
            "not given",
            (
                f"reference {report.path_m / report.path_ratio:.1f} m"
                if report.path_ratio
                else "unknown"
            ),
        ),
        (
            "90 % and 99 % swept after",
            f"{_time(report.t90_s)} and {_time(report.t99_s)}",
            "not given",
            f"bound {0.9 * report.min_time_s:.0f} s and {0.99 * report.min_time_s:.0f} s",
        ),
    ]
    return ("", "this run", "the paper", "bound or reference"), rows


def _time(seconds: float | None) -> str:
    return "never" if seconds is None else f"{seconds:.0f} s"


def hole_rows(found: list[Hole]) -> Rows:
    """Return the rows of the unswept pieces."""
    rows: list[Row] = [
        (str(n), f"{h.area_cm2:.0f}", f"{1000 * h.inradius_m:.0f}", f"{h.x_m:.2f}, {h.y_m:.2f}")
        for n, h in enumerate(found, 1)
    ]
    return ("piece", "area, cm²", "inradius, mm", "position x, y (m)"), rows


def stream_rows(data: RunData) -> Rows:
    """Return the statistics of each message type."""
    rows: list[Row] = []
    for name, stream in sorted(data.streams.items()):
        rate = "" if stream.rate_hz is None else f"{stream.rate_hz:.1f}"
        gaps, longest = (
            ("", "")
            if not stream.asked_hz
            else (
                str(stream.gaps),
                f"{1000 * stream.longest_s:.0f}",
            )
        )
        asked = f"{stream.asked_hz:g}" if stream.asked_hz else ""
        rows.append((name, str(stream.count), rate if asked else "", asked, gaps, longest))
    return ("message", "count", "rate, Hz", "default, Hz", "gaps", "longest pause, ms"), rows


def event_rows(data: RunData) -> Rows:
    """Return the events in order."""
    shown = _shown(data)
    rows: list[Row] = [(f"{h.time_s:.2f}", h.severity, h.source, h.kind, h.text) for h in shown]
    return ("time, s", "", "source", "kind", "text"), rows


def _shown(data: RunData) -> list[LoggedEvent]:
    """Return all events or, if there are too many, the most severe events."""
    happenings = data.happenings
    if len(happenings) <= _MAX_EVENTS:
        return happenings
    rank = {"error": 0, "warning": 1, "info": 2}
    best = sorted(happenings, key=lambda h: rank.get(h.severity, 3))[:_MAX_EVENTS]
    return sorted(best, key=lambda h: h.time_s)


def event_note(data: RunData) -> str:
    """Return the injected faults, and the number of omitted events."""
    faults = data.metadata.get("faults")
    note = f"Injected faults: {faults}. " if faults else ""
    if len(data.happenings) > _MAX_EVENTS:
        note += f"The table shows the {_MAX_EVENTS} most severe of {len(data.happenings)} events."
    return note


def settings(data: RunData) -> list[Row]:
    """Return the settings of the run, its robot and its file."""
    model = data.track.model
    rows: list[Row] = [
        ("log", f"{data.path} ({data.file_bytes / 1e6:.1f} MB, {data.duration_s:.1f} s)"),
        ("complete file", "yes" if data.whole else "no, its end is missing"),
        *(("damage in the file", problem) for problem in data.problems),
    ]
    rows += [(key.replace("_", " "), data.metadata[key]) for key in _KEYS if data.metadata.get(key)]
    size = f"Φ {model.radius_m * 2:.2f} m, mouth {model.cleaning_width_m:.2f} m wide"
    rows.append(("robot", f"{size}, cruise {model.cruise_speed_m_s:.2f} m/s"))
    if data.coverage is not None:
        c = data.coverage
        rows.append(("floor", f"{c.free_m2:.2f} m² free, {c.sweepable_m2:.2f} m² sweepable"))
    if data.clock:
        bounds = sorted(bound for _, bound, _, _ in data.clock)
        at = bounds[min(len(bounds) - 1, int(0.95 * len(bounds)))]
        rows.append(
            ("clock", f"error bound at p95 {at:.3f} ms, drift {data.clock[-1][3]:+.1f} ppm")
        )
    return rows
