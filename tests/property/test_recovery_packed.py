"""Packing a map into two bits a cell, after any drive, measurements and bumps."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.coverage.recovery import packed
from bridge.coverage.recovery.evidence_kernels import SURE
from bridge.coverage.recovery.geometry import PlannerGeometry
from bridge.coverage.recovery.map import EvidenceMap
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.coverage.recovery.window import Buffers, SearchWindow
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from support.observed import AT_REST

if TYPE_CHECKING:
    from numpy.typing import NDArray

MODEL, OPTIONS = RobotModel(), RecoveryOptions()
GEOMETRY = PlannerGeometry.from_model(MODEL, OPTIONS)
LAYERS = ("swept", "wall", "inflated", "blocked", "visited", "attempts")
place = st.tuples(
    st.floats(-0.8, 0.8, allow_nan=False),
    st.floats(-0.8, 0.8, allow_nan=False),
    st.floats(-3.1, 3.1, allow_nan=False),
)
acts = st.lists(
    st.tuples(
        st.sampled_from(["drive", "drive", "thing", "hint", "bump", "block", "vain"]),
        place,
        st.floats(0.04, 0.3),
        st.booleans(),
    ),
    max_size=14,
)


def driven(memory: EvidenceMap, start: Pose2, end: Pose2, range_m: float, *, seen: bool) -> None:
    for k in range(1, 41):
        share = k / 40.0
        x = start.x_m + share * (end.x_m - start.x_m)
        y = start.y_m + share * (end.y_m - start.y_m)
        right_m = range_m if seen else None
        pose = Pose2(x, y, end.theta_rad)
        seen_there = AT_REST._replace(time_s=0.1 * k, pose=pose, v_m_s=0.2)
        memory.update(seen_there._replace(infrared_right_m=right_m))


def remembered(reported: list[tuple[str, tuple[float, float, float], float, bool]]) -> EvidenceMap:
    at = Pose2(0.1, 0.37, 0.0)  # a start between the cells' corners
    memory = EvidenceMap(MODEL, OPTIONS, at)
    for act, spot, size_m, flag in reported:
        pose = Pose2(*spot)
        if act == "drive":
            driven(memory, at, pose, size_m, seen=flag)
            at = pose
        elif act == "bump":
            memory.add_bump(at, left=flag, right=True)
        elif act == "block":
            memory.block(pose.x_m, pose.y_m, 0.5 * size_m)
        elif act == "vain":
            memory.abandon(pose.x_m, pose.y_m, size_m)
            if flag:
                memory.abandon(pose.x_m, pose.y_m, size_m)
        else:
            memory.add_point(pose.x_m, pose.y_m, 1 if act == "hint" else 2)
    return memory


def box_of(memory: EvidenceMap) -> tuple[slice, slice]:
    r0, r1, c0, c1 = memory.box(MODEL.radius_m + packed.RIM_M)
    return np.s_[r0:r1, c0:c1]


def seen_by_the_planner(memory: EvidenceMap) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the cells where the axle can be, and the cells that need no sweeping."""
    window = SearchWindow(
        memory, memory.box(MODEL.radius_m + packed.RIM_M), OPTIONS.max_attempts, Buffers()
    )
    # the cells of the window's rim are closed
    return window.open[1:-1, 1:-1] > 0, window.done[1:-1, 1:-1] > 0


def around(there: NDArray[Any]) -> NDArray[Any]:
    """Return the cells that the axle cannot enter because of obstacles."""
    reach = GEOMETRY.inflation_cells
    rows, columns = np.indices(there.shape)
    blocked = np.zeros(there.shape, dtype=bool)
    for row, column in np.argwhere(there).tolist():
        blocked |= np.hypot(rows - row, columns - column) <= reach
    return blocked


@given(acts)
def test_packing_after_unpacking_gives_the_same_bytes(
    reported: list[tuple[str, tuple[float, float, float], float, bool]],
) -> None:
    memory = remembered(reported)
    before = memory.packed()
    memory.unpack(before)
    assert memory.packed() == before
    layers = {name: getattr(memory, name).copy() for name in LAYERS}
    memory.unpack(memory.packed())
    assert all((getattr(memory, name) == layer).all() for name, layer in layers.items())


@given(acts)
def test_observations_survive_as_documented(
    reported: list[tuple[str, tuple[float, float, float], float, bool]],
) -> None:
    memory = remembered(reported)
    part = box_of(memory)
    before = {name: getattr(memory, name).copy()[part] for name in LAYERS}
    open_before, done_before = seen_by_the_planner(memory)
    memory.unpack(memory.packed())
    after = {name: getattr(memory, name)[part] for name in LAYERS}
    open_after, done_after = seen_by_the_planner(memory)

    visited, there = before["visited"] > 0, before["wall"] >= SURE
    assert ((after["visited"] > 0) == visited).all()
    assert ((after["wall"] >= SURE) == (there & ~visited)).all()
    swept = before["swept"] > 0
    assert (after["swept"] > 0)[swept & ~(there & ~visited)].all()
    given_up = before["attempts"] >= OPTIONS.max_attempts
    assert not (after["swept"] > 0)[~(swept | given_up | visited)].any()

    assert (done_after | ~done_before).all()
    assert not (done_after & ~done_before & ~visited[1:-1, 1:-1]).any()
    # Unpacking closes no passable cell, and then only known obstacles block the axle.
    assert (open_after | ~open_before).all()
    blocked = around(there & ~visited)
    assert (open_after == (visited | ~blocked)[1:-1, 1:-1]).all()
    # Only a bump, an obstacle outside the box or an obstacle where the axle was can be lost.
    if not (before["blocked"] > 0).any() and ((before["inflated"] > 0) == blocked).all():
        assert (open_after == open_before).all()


@given(st.integers(1, 9), st.integers(1, 9), st.data())
def test_any_kinds_of_any_shape_come_back(rows: int, columns: int, data: st.DataObject) -> None:
    flat = data.draw(st.lists(st.integers(0, 3), min_size=rows * columns, max_size=rows * columns))
    kind = np.array(flat, dtype=np.uint8).reshape(rows, columns)
    there = packed.pack(1.0, 2.0, kind)
    assert len(there.cells) == (rows * columns + 3) // 4
    assert (packed.unpack(there) == kind).all()
    longer = packed.PackedMap(1.0, 2.0, rows, columns, there.cells + b"\0")
    with pytest.raises(ValueError, match="bytes for"):
        packed.unpack(longer)


def test_a_wall_that_the_robot_touched_is_in_the_box() -> None:
    """The box reaches beyond the footprint at the outermost position of the axle."""
    memory = EvidenceMap(MODEL, OPTIONS, Pose2(0.0, 0.0, 0.0))
    start, end = Pose2(0.0, 0.0, 0.0), Pose2(0.5, 0.0, 0.0)
    driven(memory, start, end, 0.067, seen=True)
    walls = int((memory.wall >= SURE).sum())
    assert walls > 20
    memory.unpack(memory.packed())
    assert int((memory.wall >= SURE).sum()) == walls
