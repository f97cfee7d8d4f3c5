"""Missed floor of many runs in one room: the share of runs that left each cell unswept."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import ndimage

from bridge.evaluation.metrics import CoverageMeter
from bridge.record.errors import LogReadError
from bridge.view.report.drawing import as_png, as_svg, blank, drawn_text, floor_axes
from bridge.view.report.page import Tile, document, section, table
from bridge.view.report.picture import draw_plan, plan_legend
from bridge.view.report.run_track import load_track

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel
    from bridge.view.report.run_track import RunTrack

_RESOLUTION_M = 0.01
"""Size of a cell, m. The coverage metrics are defined for this size."""
_OFTEN = 0.5
"""Minimum share of the runs that miss a cell that counts as often missed."""
_MIN_PIECE_CM2 = 5.0
"""Minimum area of a piece that is listed and outlined, cm²."""
_MAX_PIECES = 20
"""Maximum number of listed pieces of a room."""
_MAP_WIDTH, _MAX_HEIGHT, _REST = 8.0, 9.5, 1.3
"""Sizes in inches: width and maximum height of a map, and height of title and legend."""
_ALWAYS = "#7b1020"


@dataclass(slots=True)
class MissedPiece:
    """A connected piece of floor that at least half of the runs missed."""

    x_m: float
    y_m: float
    area_cm2: float
    share: float
    """Mean share of the runs that missed the piece."""


@dataclass(slots=True)
class RoomMisses:
    """All runs in one room."""

    name: str
    plan: FloorPlan
    origin_m: tuple[float, float]
    reached: NDArray[np.int32]
    """Number of runs per cell whose robot could sweep the cell (rows along y)."""
    missed: NDArray[np.int32]
    """Number of these runs per cell that did not sweep the cell."""
    shares: list[float] = field(default_factory=list)
    """Coverage of each run (``mouth_sweepable``, 0 to 1)."""

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.shares)

    @property
    def missed_share(self) -> NDArray[np.float64]:
        """Share of the runs per cell that missed the cell; NaN where no robot could sweep."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.missed / np.where(self.reached, self.reached, np.nan))

    def area_cm2(self, share: float) -> float:
        """Return the area that at least this share of the runs missed, cm²."""
        with np.errstate(invalid="ignore"):
            cells = np.count_nonzero(self.missed_share >= share)
        return float(cells) * _RESOLUTION_M**2 * 1e4

    def pieces(self) -> list[MissedPiece]:
        """Return the pieces that at least half of the runs missed, the largest first."""
        share = self.missed_share
        with np.errstate(invalid="ignore"):
            labels, count = ndimage.label(share >= _OFTEN, structure=np.ones((3, 3)))
        found = []
        for number in range(1, count + 1):
            rows, columns = np.nonzero(labels == number)
            area_cm2 = len(rows) * _RESOLUTION_M**2 * 1e4
            if area_cm2 >= _MIN_PIECE_CM2:
                x0, y0 = self.origin_m
                x_m = x0 + (float(columns.mean()) + 0.5) * _RESOLUTION_M
                y_m = y0 + (float(rows.mean()) + 0.5) * _RESOLUTION_M
                found.append(MissedPiece(x_m, y_m, area_cm2, float(share[rows, columns].mean())))
        return sorted(found, key=lambda piece: -piece.area_cm2)[:_MAX_PIECES]


@dataclass(slots=True)
class Misses:
    """Missed floor by room, and the logs that could not be used."""

    rooms: list[RoomMisses] = field(default_factory=list)
    unused: list[tuple[Path, str]] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """Return the results as values for JSON."""
        return {
            "rooms": [
                {
                    "room": room.name,
                    "runs": room.runs,
                    "coverage": round(float(np.mean(room.shares)), 4),
                    "always_missed_cm2": round(room.area_cm2(1.0), 1),
                    "often_missed_cm2": round(room.area_cm2(_OFTEN), 1),
                    "pieces": [
                        {
                            "x_m": round(piece.x_m, 3),
                            "y_m": round(piece.y_m, 3),
                            "area_cm2": round(piece.area_cm2, 1),
                            "missed_share": round(piece.share, 4),
                        }
                        for piece in room.pieces()
                    ],
                }
                for room in self.rooms
            ],
            "unused": [{"log": str(path), "reason": reason} for path, reason in self.unused],
        }


def gather_misses(
    logs: Iterable[Path], progress: Callable[[int], None] = lambda _done: None
) -> Misses:
    """Read the robot's path from each log, and count the missed cells.

    Args:
        logs: The logs.
        progress: Called with the number of logs read.

    """
    gathered = Misses()
    rooms: dict[object, RoomMisses] = {}
    meters: dict[tuple[object, RobotModel], CoverageMeter] = {}
    for done, path in enumerate(logs):
        progress(done)
        try:
            track = load_track(path)
        except LogReadError as error:
            gathered.unused.append((path, error.reason))
            continue
        if track.plan is None or not track.best:
            reason = "the room is not known" if track.plan is None else "it has no pose"
            gathered.unused.append((path, reason))
            continue
        place = track.plan.walls, track.plan.obstacles, track.plan.cliffs
        meter = meters.get((place, track.model))
        if meter is None:
            meter = meters[place, track.model] = CoverageMeter(
                track.plan, track.model, _RESOLUTION_M
            )
        _count(rooms, place, track, meter)
    gathered.rooms = sorted(rooms.values(), key=lambda room: (-room.runs, room.name))
    return gathered


def _count(
    rooms: dict[object, RoomMisses], place: object, track: RunTrack, meter: CoverageMeter
) -> None:
    report = meter.measure((time_s, *pose) for time_s, pose in track.best)
    sweepable = meter.regions.sweepable
    key = place, sweepable.shape, report.origin_m
    room = rooms.get(key)
    if room is None:
        assert track.plan is not None  # noqa: S101 - checked by the caller
        nought = np.zeros(sweepable.shape, dtype=np.int32)
        room = rooms[key] = RoomMisses(
            track.plan.name, track.plan, report.origin_m, nought, nought.copy()
        )
    room.reached += sweepable
    room.missed += sweepable & ~np.isfinite(report.first_swept_s)
    room.shares.append(report.coverage.mouth_sweepable)


def heatmap_picture(misses: Misses) -> bytes:
    """Return the maps of all rooms as one PNG.

    Raises:
        PlotMissingError: matplotlib is not installed.

    """
    heights = [_height(room) for room in misses.rooms]
    figure = blank(_MAP_WIDTH, sum(heights))
    below = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    for part, room in zip(below, misses.rooms, strict=True):
        _draw(part.add_subplot(), room)
    return as_png(figure)


def heatmap_page(misses: Misses, what: str) -> str:
    """Return the page with the maps, the pieces and the unused logs.

    Args:
        misses: The collected misses.
        what: The selection in words.

    """
    parts = []
    for room in misses.rooms:
        note = "Of the floor that the mouth could reach."
        parts.append(section(f"{room.name}: {_counted(room.runs)}", _map_svg(room), note))
        head = ("at x, y (m)", "area, cm²", "missed by, % of the runs")
        rows = [
            (f"{p.x_m:.2f}, {p.y_m:.2f}", f"{p.area_cm2:.0f}", f"{100 * p.share:.0f}")
            for p in room.pieces()
        ]
        parts.append(table(f"{room.name}: missed by at least half of the runs", head, rows))
    if misses.unused:
        unused = [(str(path), reason) for path, reason in misses.unused]
        parts.append(table("Logs that were not used", ("log", "reason"), unused))
    runs = sum(room.runs for room in misses.rooms)
    lead = f"<p>{escape(what)}</p>"
    return document("What is missed", _counted(runs), lead, _tiles(misses), parts)


def _tiles(misses: Misses) -> list[Tile]:
    shares = [share for room in misses.rooms for share in room.shares]
    if not shares:
        return []
    always = sum(room.area_cm2(1.0) for room in misses.rooms)
    often = sum(room.area_cm2(_OFTEN) for room in misses.rooms)
    return [
        Tile(str(len(shares)), "runs"),
        Tile(f"{100 * float(np.mean(shares)):.1f} %", "swept of what the mouth can reach, mean"),
        Tile(f"{100 * min(shares):.1f} %", "swept in the worst run"),
        Tile(f"{always:.0f} cm²", "missed by every run"),
        Tile(f"{often:.0f} cm²", "missed by at least half of the runs"),
    ]


def _counted(runs: int) -> str:
    return f"{runs} run{'' if runs == 1 else 's'}"


def _height(room: RoomMisses) -> float:
    rows, columns = room.reached.shape
    return float(min(_MAP_WIDTH * 0.66 * rows / columns + _REST, _MAX_HEIGHT))


def _map_svg(room: RoomMisses) -> str:
    figure: Figure = blank(_MAP_WIDTH, _height(room))
    _draw(figure.add_subplot(), room)
    return as_svg(figure)


def _draw(axes: Axes, room: RoomMisses) -> None:
    from matplotlib.lines import Line2D  # noqa: PLC0415 - an extra
    from matplotlib.patches import Patch  # noqa: PLC0415 - an extra

    share = 100.0 * room.missed_share
    x0, y0 = room.origin_m
    rows, columns = share.shape
    extent = (x0, x0 + columns * _RESOLUTION_M, y0, y0 + rows * _RESOLUTION_M)
    shown = axes.imshow(
        np.ma.masked_invalid(share),
        origin="lower",
        extent=extent,
        cmap="YlOrRd",
        vmin=0.0,
        vmax=100.0,
        interpolation="nearest",
        zorder=1,
    )
    always = _without_crumbs(np.nan_to_num(share) >= 100.0)  # noqa: PLR2004 - all of them, in per cent
    if always.any():
        axes.contour(
            always.astype(float),
            levels=[0.5],
            extent=extent,
            colors=[_ALWAYS],
            linewidths=0.9,
            zorder=3,
        )
    draw_plan(axes, room.plan)
    floor_axes(axes)
    axes.figure.colorbar(shown, ax=axes, label="missed by, % of the runs", shrink=0.8)
    mean = 100.0 * float(np.mean(room.shares))
    title = f"{room.name}: {_counted(room.runs)}, {mean:.1f} % swept on average"
    axes.set_title(drawn_text(title), fontsize=10, loc="left")
    lines = [Line2D([], [], color=_ALWAYS, lw=0.9, label="around what every run missed")]
    unreachable = Patch(
        facecolor="white", edgecolor="0.6", label="white: the mouth cannot reach it"
    )
    axes.legend(
        handles=[*(lines if always.any() else []), unreachable, *plan_legend(room.plan)],
        frameon=False,
        fontsize=8,
        ncols=3,
        loc="upper left",
        bbox_to_anchor=(0.0, -0.1),
    )


def _without_crumbs(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells without the pieces that are too small to be listed."""
    labels, _ = ndimage.label(cells, structure=np.ones((3, 3)))
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    kept: NDArray[np.bool_] = sizes[labels] * _RESOLUTION_M**2 * 1e4 >= _MIN_PIECE_CM2
    return kept
