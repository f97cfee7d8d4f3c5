"""Every unswept cell gets one cause; the expected causes are found by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bridge.coverage.recovery.map import EvidenceMap
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.evaluation.regions import find_regions
from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from tools.experiment.unswept_causes import CAUSES, classify, forbidden_axle

if TYPE_CHECKING:
    from bridge.evaluation.raster import Mask

MODEL = RobotModel()
SIDE_M = 2.0
PLAN = FloorPlan(
    "square",
    ((0.0, 0.0), (SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M)),
    (),
    Pose2(1.0, 1.0, 0.0),
)
REGIONS = find_regions(PLAN, MODEL, 0.01)
RASTER = REGIONS.raster
ALL = REGIONS.sweepable
NOTHING = RASTER.empty()
END = (1.0, 1.0)


def losses(
    swept: Mask, believed: Mask | None = None, forbidden: Mask | None = None
) -> dict[str, float]:
    found = classify(
        REGIONS,
        MODEL.mouth_reach_m,
        swept,
        swept if believed is None else believed,
        forbidden,
        END,
    )
    missing = np.count_nonzero(ALL & ~swept) / np.count_nonzero(ALL)
    assert sum(found.values()) == pytest.approx(missing, abs=1e-12)
    return found


def share(area_m2: float) -> float:
    return area_m2 / RASTER.area_m2(ALL)


def strip(x0: float, x1: float) -> Mask:
    mask: Mask = (RASTER.x >= x0) & (RASTER.x < x1) & ALL
    return mask


def test_nothing_is_lost_where_all_is_swept() -> None:
    assert losses(ALL) == dict.fromkeys(CAUSES, 0.0)


def test_a_strip_along_the_wall_is_a_wall_gap() -> None:
    # the mouth sweeps up to 8 cm from the wall, and its outermost 1.5 cm only in contact
    found = losses(ALL & ~strip(0.08, 0.095))
    height_m = SIDE_M - 2 * 0.08
    assert found["wall gap"] == pytest.approx(share(0.015 * height_m), rel=0.1)
    assert found["lane gap"] == pytest.approx(0.0, abs=1e-3)
    assert found["early end"] == found["pose"] == found["false evidence"] == 0.0


def test_a_sliver_inside_is_a_lane_gap_and_a_wide_piece_an_early_end() -> None:
    sliver, piece = strip(0.80, 0.83), strip(1.2, 1.5)
    found = losses(ALL & ~sliver & ~piece)
    # both ends of the strips are in the bands of 2 cm along the walls
    inner_m = SIDE_M - 2 * 0.10
    assert found["lane gap"] == pytest.approx(share(0.03 * inner_m), rel=0.05)
    assert found["early end"] == pytest.approx(share(0.30 * inner_m), rel=0.05)
    assert found["wall gap"] == pytest.approx(share(0.33 * 2 * 0.02), rel=0.3)


def test_floor_swept_only_by_the_estimate_is_lost_to_the_pose() -> None:
    piece = strip(1.2, 1.5)
    found = losses(ALL & ~piece, believed=ALL)
    assert found["pose"] == pytest.approx(np.count_nonzero(piece) / np.count_nonzero(ALL))


def test_a_false_wall_costs_all_floor_behind_it() -> None:
    # a false wall across the room: the axle must not enter x = 1.2 to 1.5
    forbidden = (RASTER.x >= 1.2) & (RASTER.x < 1.5)
    behind = RASTER.x >= 1.2 + 0.08 + 0.025
    found = losses(ALL & (RASTER.x < 1.28), forbidden=forbidden)
    expected = np.count_nonzero(behind & ALL) / np.count_nonzero(ALL)
    assert found["false evidence"] == pytest.approx(expected, rel=0.02)
    assert found["early end"] == 0.0


def test_a_true_map_is_no_false_evidence() -> None:
    # the map blocks up to 2 cm more than the walls, because its cells have a side of 2 cm
    margin = MODEL.radius_m + 0.02
    inside = (
        (margin <= RASTER.x)
        & (SIDE_M - margin >= RASTER.x)
        & (margin <= RASTER.y)
        & (SIDE_M - margin >= RASTER.y)
    )
    found = losses(NOTHING, forbidden=~inside)
    corner = (MODEL.cleaning_width_m / 2) ** 2 * (4 - math.pi)
    assert found["false evidence"] <= share(corner)
    assert found["early end"] > 0.8


def test_a_true_map_is_no_false_evidence_for_a_mouth_ahead_of_the_axle() -> None:
    model = replace(MODEL, mouth_offset_m=0.10)
    regions = find_regions(PLAN, model, 0.01)
    nothing = regions.raster.empty()
    forbidden = ~regions.centres
    found = classify(regions, model.mouth_reach_m, nothing, nothing, forbidden, END)
    assert found["false evidence"] == 0.0


def test_a_planners_map_is_read_in_its_own_frame() -> None:
    memory = EvidenceMap(MODEL, RecoveryOptions(), Pose2(1.0, 1.0, 0.0))
    for x_m, y_m in ((0.3, 0.7), (1.0, 1.02)):
        memory.add_point(x_m, y_m)
    mask = forbidden_axle(memory, RASTER)
    away_m = np.hypot(RASTER.x - 0.3, RASTER.y - 0.7)
    cell_m = memory.geometry.cell_m
    assert mask[away_m < MODEL.radius_m - 2.0 * cell_m].all()
    left = RASTER.x < 0.6
    assert not mask[left & (away_m > MODEL.radius_m + 2.0 * cell_m)].any()
    own_cell = (abs(RASTER.x - 1.01) < 0.01) & (abs(RASTER.y - 1.01) < 0.01)
    beside = (abs(RASTER.x - 1.03) < 0.01) & (abs(RASTER.y - 1.01) < 0.01)
    assert mask[beside].all()
    assert not mask[own_cell].any(), "the axle was there"
