"""Carpets, thresholds and cliffs in pictures and legends, and the text of a planner state."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from bridge.floor_plan.floor_plan import FloorPlan, parse_floorplan
from bridge.view.report.picture import draw_plan, plan_legend
from bridge.view.rerun.planning import describe

PLAIN = parse_floorplan('{"walls": [[0,0],[4,0],[4,3],[0,3]], "start": [0.4,0.4,0]}')
MARKED = parse_floorplan(
    """{"walls": [[0,0],[4,0],[4,3],[0,3]], "start": [0.4,0.4,0],
    "obstacles": [[[2.6,1.8],[3.2,1.8],[3.2,2.4],[2.6,2.4]]],
    "carpets": [{"polygon": [[0.8,0.8],[2.2,0.8],[2.2,2.2],[0.8,2.2]]}],
    "thresholds": [{"line": [[2.5,0],[2.5,1.2]], "height_m": 0.004}],
    "cliffs": [[[3.4,0.2],[3.9,0.2],[3.9,0.8],[3.4,0.8]]]}"""
)
CARPET, THRESHOLD, CLIFF = "#8455a8", "#c98a00", "#c0392b"


def drawn(plan: FloorPlan) -> dict[str, list[tuple[float, float]]]:
    """Return the corners of the drawn areas, by colour."""
    axes = Figure().add_subplot()
    draw_plan(axes, plan)
    found = {
        to_hex(patch.get_edgecolor()): [
            (float(x), float(y)) for x, y in np.asarray(patch.get_path().vertices)
        ]
        for patch in axes.patches
    }
    for line in axes.lines:
        xs, ys = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        points = zip(xs.tolist(), ys.tolist(), strict=True)
        found[to_hex(str(line.get_color()))] = list(points)
    return found


def test_everything_that_a_room_has_is_drawn_where_it_is() -> None:
    found = drawn(MARKED)
    assert set(MARKED.carpets[0].polygon) <= set(found[CARPET])
    assert set(MARKED.cliffs[0]) <= set(found[CLIFF])
    assert found[THRESHOLD] == [MARKED.thresholds[0].begin, MARKED.thresholds[0].end]
    assert set(drawn(PLAIN)) == {"#30343b"}


@pytest.mark.parametrize(
    ("plan", "labels"),
    [(MARKED, ["carpet", "threshold", "cliff: no floor"]), (PLAIN, []), (None, [])],
)
def test_the_legend_names_the_rooms_objects(plan: FloorPlan | None, labels: list[str]) -> None:
    assert [entry.get_label() for entry in plan_legend(plan)] == labels


@pytest.mark.parametrize(("planner", "has_lanes"), [("paper", True), ("recovery", False)])
def test_the_papers_variables_are_reported_for_its_planner_alone(
    planner: str, *, has_lanes: bool
) -> None:
    state = SimpleNamespace(
        planner=planner,
        state="lane",
        turn_count=3,
        lane_distance_m=1.0,
        previous_lane_distance_m=1.2,
        length_m=0.0,
        case=1,
        HasField=lambda _: False,
    )
    assert ("Prev-D" in describe(state)) is has_lanes
    assert planner in describe(state)
