"""Lanes, occluded regions and covariances in the viewer, for hand-written runs."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bridge.motion.robot_model import RobotModel
from bridge.view.rerun import paths, planning
from bridge.view.rerun.columns import RerunRecording

if TYPE_CHECKING:
    from collections.abc import Iterable


class Sheet(RerunRecording):
    """A recording that keeps the strips that it receives."""

    def __init__(self) -> None:
        self.strips: dict[str, list[Any]] = {}

    def style(self, entity: str, *_: object) -> None:
        self.strips.setdefault(entity, [])

    def send(self, entity: str, times_ns: list[int], columns: Iterable[Any]) -> None:
        (column,) = columns
        rows = column.as_arrow_array().to_pylist()
        assert len(rows) == len(times_ns)
        self.strips[entity] += [row[0] for row in rows]


def drawn(part: Any, entity: str) -> list[np.ndarray[Any, Any]]:  # noqa: ANN401 - any collector
    sheet = Sheet()
    part.send(sheet)
    again = Sheet()
    part.send(again)
    assert again.strips == {}, "the data is sent only once"
    return [np.array(strip) for strip in sheet.strips.get(entity, [])]


def lane(length_m: float) -> str:
    return json.dumps({"distance_m": length_m})


def test_a_lane_is_drawn_from_its_beginning_to_its_end() -> None:
    lanes = planning.Lanes()
    lanes.state(0, "lane", (0.2, 0.2, 0.0))
    lanes.state(1, "step", (1.9, 0.2, 0.0))
    lanes.state(2, "recovery-lane", (1.9, 0.4, math.pi))
    lanes.state(3, "idle", (0.9, 0.4, math.pi))
    first, second = drawn(lanes, paths.LANES)
    assert first[:, :2] == pytest.approx(np.array([[0.2, 0.2], [1.9, 0.2]]))
    assert second[:, :2] == pytest.approx(np.array([[1.9, 0.4], [0.9, 0.4]]))


def test_a_lane_cut_short_occludes_the_floor_to_where_the_others_ended() -> None:
    model = RobotModel()
    occlusions = planning.OcclusionStrips(model)
    occlusions.lane(0, lane(1.7), (1.9, 0.2, 0.0))
    occlusions.lane(1, lane(1.7), (0.2, 0.36, math.pi))
    occlusions.lane(2, lane(0.4), (0.6, 0.52, 0.0))
    occlusions.lane(3, lane(0.4), (0.2, 0.68, math.pi))  # back to the wall, so no floor is occluded
    (occluded,) = drawn(occlusions, paths.OCCLUDED)
    radius, half = model.radius_m, model.cleaning_width_m / 2
    assert occluded[:, 0].min() == pytest.approx(0.6 + radius)
    assert occluded[:, 0].max() == pytest.approx(1.9 + radius)
    assert occluded[:, 1].min() == pytest.approx(0.52 - half)
    assert occluded[:, 1].max() == pytest.approx(0.52 + half)


def test_an_occluded_region_that_the_planner_reports() -> None:
    occlusions = planning.OcclusionStrips(RobotModel())
    data = json.dumps({"occlusion": 1, "x_m": 1.0, "y_m": 0.5, "length_m": 0.8})
    occlusions.report(0, data, (0.9, 0.5, math.pi / 2))
    occlusions.report(1, "no json", (0.9, 0.5, 0.0))
    (occluded,) = drawn(occlusions, paths.OCCLUDED)
    assert (occluded[:, 1].min(), occluded[:, 1].max()) == pytest.approx((0.5, 1.3))


def test_the_ellipse_is_that_of_two_standard_deviations() -> None:
    covariance = planning.Covariance()
    estimate = SimpleNamespace(
        x_m=1.0, y_m=2.0, covariance_xx=0.04, covariance_xy=0.0, covariance_yy=0.01
    )
    covariance.add(0, estimate)
    covariance.add(1, estimate)  # ignored, because it follows the first too soon
    (ellipse,) = drawn(covariance, paths.COVARIANCE)
    assert np.ptp(ellipse[:, 0]) == pytest.approx(4 * 0.2, rel=0.01)
    assert np.ptp(ellipse[:, 1]) == pytest.approx(4 * 0.1, rel=0.01)
    assert ellipse[:, :2].mean(axis=0) == pytest.approx([1.0, 2.0], abs=0.02)
