"""Each compiled module gives the same results as its Python source, in one scenario per module."""

# A module that is loaded from its source has no type.
# ruff: noqa: ANN401

from __future__ import annotations

import importlib
import math
import os
import struct
import subprocess
import sys
import sysconfig
from enum import Enum
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bridge.floor_plan.floor_plan import Carpet, FloorPlan, Threshold
from bridge.motion.geometry import Pose2
from protocol.errors import FieldRangeError, PayloadError
from protocol.link import Rejected
from protocol.messages.device import Imu, LogText
from protocol.messages.host import Stop, VelocitySetpoint
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.framing import UartEncoder
from support.pure import load_pure
from support.root import ROOT
from tools.dev import kernels

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from types import ModuleType

    from numpy.typing import NDArray

    Scenario = Callable[[Any], list[object]]

TOLERANCE = 1e-12
"""Relative tolerance. The functions ``hypot`` of C and of Python differ in the last bit."""


def box(*sides: float) -> list[tuple[float, float]]:
    """Return the corners of a rectangle, counter-clockwise, from x0, y0, x1, y1."""
    x0, y0, x1, y1 = sides
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


def edges(*polygons: list[tuple[float, float]]) -> NDArray[np.float64]:
    """Return the edges of polygons as rows in the format of ``ray_kernel``."""
    rows = []
    for polygon in polygons:
        for (ax, ay), (bx, by) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            length = math.hypot(bx - ax, by - ay)
            unit = (bx - ax) / length, (by - ay) / length
            rows.append((ax, ay, bx - ax, by - ay, 1.0 / length**2, *unit))
    return np.array(rows)


ROOM = edges(box(0.0, 0.0, 2.0, 1.5), box(1.2, 0.6, 1.5, 0.9))
CORNERS = np.array([(0.0, 0.0, 0.0), (2.0, 1.5, 0.0), (1.2, 0.6, 1.0), (1.2, 0.9, 1.0)])


def public(thing: object) -> list[object]:
    """Return name and value of each public number of a compiled object."""
    names = (name for name in sorted(dir(type(thing))) if not name.startswith("_"))
    values = ((name, getattr(thing, name)) for name in names)
    return [(name, float(v)) for name, v in values if isinstance(v, int | float | np.number)]


def floor(rng: np.random.Generator, rows: int, cols: int) -> NDArray[np.uint8]:
    """Return a mostly free grid with some blocks and a closed border."""
    open_ = np.full((rows, cols), 2, dtype=np.uint8)
    for _ in range(5):
        row, col = rng.integers(0, rows), rng.integers(0, cols)
        open_[row : row + 6, col : col + 4] = 0
        open_[row + 6 : row + 8, col : col + 4] = 1
    open_[0] = open_[-1] = open_[:, 0] = open_[:, -1] = 0
    return open_


def evidence_kernels(m: Any) -> list[object]:
    rng = np.random.default_rng(1)
    swept, wall, inflated, visited, blocked = (np.zeros((60, 70), dtype=np.uint8) for _ in range(5))
    given: list[object] = []
    x, y, theta = 30.0, 30.0, 0.3
    for _ in range(25):
        nx, ny = (x + 4.0 * math.cos(theta)) % 70.0, (y + 4.0 * math.sin(theta)) % 60.0
        turned = theta + rng.uniform(-0.8, 0.8)
        given.append(m.sweep(swept, x, y, theta, nx, ny, turned, 3.5, 1.5))
        x, y, theta = nx, ny, turned
        bearing = rng.uniform(-math.pi, math.pi)
        ray = (math.cos(bearing), math.sin(bearing))
        m.beam(wall, inflated, x, y, *ray, 12.0, 13.0, int(rng.integers(0, 3)), 4.2)
        m.add_wall(wall, inflated, int(rng.integers(-3, 63)), int(rng.integers(-3, 73)), 2, 4.2)
        m.add_wall(wall, inflated, int(rng.integers(0, 60)), int(rng.integers(0, 70)), -6, 4.2)
        m.clear_body(wall, inflated, visited, x, y, 3.3, 4.2)
        m.bump_area(blocked, x, y, bearing - 0.5, bearing + 0.4, 8.2)
        given.append(m.fresh_ahead(swept, x, y, theta, 2.0, 15.0, -3.0, 3.0))
        asked = (0.02, 0.17, 0.15, 0.17, 0.026, 0.3, 0.1, 0.3)
        given.append(m.speed_limit_m_s(wall, x, y, theta, *asked))
    return [*given, swept, wall, inflated, visited, blocked]


def lane_costs(m: Any) -> object:
    return m.LaneCosts(20.0, 1.0, 0.9, 2.0, 1.5, 2.0, 40.0, 7, 10, 7, 4.0, 5.0, 1)


def lane_kernels(m: Any) -> list[object]:
    rng = np.random.default_rng(2)
    target_in = (floor(rng, 60, 80) == 2).astype(np.uint8)
    ways_in = np.where(target_in > 0, rng.integers(0, 300, target_in.shape), -1).astype(np.int32)
    given: list[object] = []
    for angle in (0.0, 0.4, -2.5):
        target, ways = np.zeros((70, 90), np.uint8), np.zeros((70, 90), np.int32)
        m.turn_images(target_in, ways_in, angle, -3.0, 5.0, target, ways)
        for heading in (0.0, 3.0):
            best, prices = m.BestLane(), lane_costs(m)
            sums = np.zeros((2, 90), np.int32)
            m.scan_lanes(target, ways, 12.5, 40.0, heading, prices, best, sums)
            given += [*public(best), sums]
        given += [target, ways]
    return given


def travel_kernels(m: Any) -> list[object]:
    open_ = floor(np.random.default_rng(3), 50, 60)
    open_[1:-1, 5] = 2
    dist, counts = np.full(open_.shape, -1, np.int32), np.zeros(m.RING, np.int32)
    queue, search = np.zeros((m.RING, 2048), np.int32), m.TravelSearch()
    dist[20, 5], queue[0, 0], counts[0], search.waiting = 0, 20 * 60 + 5, 1, 1
    given: list[object] = []
    done = False
    while not done:
        settled, done = m.travel(open_.ravel(), 60, 600, 150, dist.ravel(), queue, counts, search)
        given += [settled, done, *public(search)]
    corners, cells = np.zeros((50, 2), np.int32), np.zeros(2000, np.int32)
    for row, col in ((10, 50), (45, 55), (20, 5), (1, 1)):
        given += [m.trace_path(open_, dist, row, col, corners, cells), corners.copy()]
        given.append(m.clear_line(open_, 20, 5, row, col, 1))
    return [*given, dist, counts]


def window_kernels(m: Any) -> list[object]:
    rng = np.random.default_rng(4)
    layers = [(rng.random((60, 70)) < share).astype(np.uint8) for share in (0.02, 0.01, 0.2)]
    inflated, blocked, visited = layers
    swept = np.zeros((60, 70), np.uint8)
    swept[:, :35] = 1
    wall, tried = (rng.integers(0, 40, (2, 60, 70)) // 13).astype(np.uint8)
    open_, done, target, hole = (np.zeros((50, 60), np.uint8) for _ in range(4))
    m.copy_window(inflated, blocked, visited, swept, wall, tried, 2, 5, 6, open_, done)
    dist = np.where(open_ > 0, rng.integers(0, 300, open_.shape), -1).astype(np.int32)
    ways = np.zeros_like(dist)
    given: list[object] = [m.mark_targets(dist, 250, done, target, ways, 12)]
    for heading in (0.0, 2.9):
        best, prices = (
            m.BestPerimeter(),
            m.PerimeterCosts(28.0, 0.85, 0.9, 500.0, 70.0, 2.0, 40.0, 4, 4.0, 1.0),
        )
        m.scan_perimeters(open_, ways, done, 20.0, 20.0, heading, prices, best)
        given += public(best)
    marked = target.copy()
    given.append(m.keep_holes(target, hole, 4))
    weighed = marked.copy()
    m.weigh_pieces(weighed, open_, done, ways, np.zeros(3000, np.int32), 100.0, 20, 3)
    return [*given, open_, done, ways, marked, target, weighed]


def raster_kernel(m: Any) -> list[object]:
    rng = np.random.default_rng(5)
    row, col = np.indices((40, 50), dtype=np.float64)
    xs, ys = col + rng.random(col.shape), row + rng.random(col.shape)
    mask, times = np.zeros((40, 50), np.bool_), np.full((40, 50), np.inf)
    for k in range(6):
        ax, ay, ex, ey = rng.uniform(5.0, 35.0, 4)
        segment = (ax, ay, ex - 20.0, ey - 20.0, 3.0)
        m.capsule(mask.view(np.uint8), xs, ys, 0, 40, 0, 50, *segment)
        corners = rng.uniform(0.0, 45.0, (2, 6))
        m.sweep(times, xs, ys, 2, 38, 1, 49, corners, np.zeros((2, 3, 4)), 5.0 - k)
    m.capsule(mask.view(np.uint8), xs, ys, 0, 40, 0, 50, 9.0, 9.0, 0.0, 0.0, 4.0)
    return [mask, times]


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def records_kernel(m: Any) -> list[object]:
    rng = np.random.default_rng(6)
    messages = [
        record(5, struct.pack("<HIQQ", k % 3, k, k, k) + bytes(rng.integers(0, 9, 12).tolist()))
        for k in range(20)
    ]
    chunk = b"".join([record(4, b"channel"), *messages])
    given: list[object] = []
    for content in (chunk, chunk[:-5], chunk + bytes(30), b"\x05" + b"\xff" * 30, b""):
        places, lengths, channels = np.zeros((3, 64), np.int64)
        data = np.frombuffer(content, np.uint8)
        given += [m.find_records(data, places, lengths, channels), places, lengths, channels]
    data = np.frombuffer(b"".join(messages), np.uint8)
    starts = np.arange(20, dtype=np.int64) * len(messages[0])
    shape, mask = np.frombuffer(messages[0][31:], np.uint8), np.zeros(12, np.uint8)
    mask[:2] = 0x04
    values = np.array([(31, 8, 0), (39, 4, 160), (36, 3, 240)])
    out, fits = np.zeros(300, np.uint8), np.zeros(20, np.uint8)
    given += [m.split_messages(data, starts, 31, shape, mask, values, out, fits), out, fits]
    indexes = record(7, struct.pack("<HI", 1, 32) + bytes(32)) * 3
    for content in (indexes, indexes + chunk, indexes[:-1], record(7, b"\x01" * 10)):
        given.append(m.skip_indexes(np.frombuffer(content, np.uint8)))
    return given


def rows_kernel(m: Any) -> list[object]:
    kinds = [
        *((m.WHOLE, 1, w) for w in (1, 2, 4, 8)),
        *((m.SECONDS, 1, 4), (m.NANOSECONDS, 1, 4), (m.STAMP, 1, 12)),
        *((m.SCALED, 2, 4), (m.SCALED, 2, 8), (m.FLOAT, 0, 4), (m.FLOAT, 0, 8)),
        *((m.SIN_HALF, 1, 8), (m.COS_HALF, 1, 8), (m.COS_HALF, 1, 4)),
    ]
    begin, ops = 3, []
    for kind, column, width in kinds:
        ops.append((begin, kind, column, width))
        begin += width
    size = begin + 2
    times = 1_760_000_000_123_456_789 + 10_000_000 * np.arange(7)[::-1]
    ints = np.stack([size * np.arange(7), times, np.arange(-3, 4) * 1000], axis=1)
    floats = np.random.default_rng(7).uniform(-4.0, 4.0, (7, 2))
    scales = np.tile([0.0123, -4.5], (len(ops), 1))
    out, index = np.zeros(7 * size, np.uint8), np.zeros((2, 7, 2), np.int64)
    template = np.arange(size, dtype=np.uint8)
    places = np.array([0, 40])
    arrays = (np.ascontiguousarray(ints), floats, template, np.array(ops), scales, out)
    return [*m.pack_rows(*arrays, 1, places, index), out, index]


def body_of(m: Any) -> Any:
    b = m.Body()
    b.tau_s, b.decay, b.back_emf_v_s, b.resistance_ohm = 0.05, 0.0198, 1.1, 8.0
    b.friction_v, b.drop_v, b.load_v_n, b.radius_m = 0.5, 1.8, 0.236, 0.17
    b.wheel_base_m, b.wall_friction, b.traction_n, b.rad_s_per_n = 0.23, 0.2, 7.0, 0.02
    b.caster_n, b.caster_x_m, b.full_v, b.capacity_ah = 0.3, 0.115, 16.0, 0.001
    b.empty_ratio, b.battery_ohm, b.knee, b.knee_fall = 0.85, 0.15, 0.05, 0.4
    b.knee_resistance, b.electronics_w, b.unslipped = 4.0, 1.5, 0.99
    b.slip_kick, b.slip_fade, b.charge_ah = 0.002, 0.01, 0.001
    b.left.radius_m, b.right.radius_m = 0.0325, 0.0326
    b.take_draws(np.random.default_rng(8).standard_normal(m.SLIP_DRAWS))
    b.x_m, b.y_m, b.theta_rad = 0.5, 0.4, 0.2
    b.take_edges(ROOM)
    m.tread(b)
    m.sag(b)
    return b


def drive_kernel(m: Any) -> list[object]:
    b = body_of(m)
    given: list[object] = []
    m.advance(0, 0.0, 0.0, b)
    duties = [(0.9, 0.9)] * 220 + [(-0.7, 0.7)] * 40 + [(0.9, 0.8)] * 120 + [(0.0, 0.0)] * 20
    for period, (left, right) in enumerate(duties):
        if period == 60:  # a person walks towards the robot
            b.walker_x_m, b.walker_y_m, b.walker_radius_m = b.x_m, b.y_m + 0.35, 0.05
            b.walker_vy_m_s, b.walker_ms, b.disturbed = -0.5, 200.0, True
        b.left.slope_n, b.right.carpet_n = (2.0, 0.5) if 100 < period < 130 else (0.0, 0.0)
        b.left.stuck = 300 < period < 310
        b.lifted, b.held = 320 < period < 325, 330 < period < 335
        b.tilt_x_m_s2 = 0.1 if period % 7 == 0 else 0.0
        m.advance(4, left, right, b)
        m.advance(6, left, right, b)
        given += [m.renew(b), m.felt(b), b.normals()]
        if b.draws_used() >= m.SLIP_DRAWS - 1:
            b.take_draws(np.linspace(-1.0, 1.0, b.draws_used()))
        if period == 200:
            b.touch(0.6, 0.8)
    m.discharge_battery(b)
    m.switch(0.5, -0.5, b)
    assert b.collisions > 0
    assert b.contact_ms > 0.0
    return [*given, *public(b), *public(b.left), *public(b.right)]


def wheel_kernel(m: Any) -> list[object]:
    left, right = m.WheelControlState(0.013), m.WheelControlState(0.0131)
    loop = m.Loop(left, right)
    loop.feed_forward, loop.friction, loop.proportional = 2.12, 0.15, 1.6
    loop.integral_gain, loop.integral_limit, loop.half_base_m = 0.12, 0.5, 0.115
    loop.v_max, loop.yaw_max, loop.v_step, loop.yaw_step = 0.3, 2.0, 0.01, 0.09
    rng = np.random.default_rng(9)
    counts = np.array([65_500, 40])
    given: list[object] = []
    for k in range(120):
        counts = (counts + rng.integers(-2, 20, 2) * (k < 90)) % 65_536
        wanted = (0.25, 0.5) if k < 60 else (-0.2, 0.0) if k < 110 else (0.0, 0.0)
        given += m.control(loop, *wanted, *counts.tolist(), 15.0 - 0.1 * k)
    return [*given, *public(loop), *public(left), *public(right)]


def imu_kernel(m: Any) -> list[object]:
    rng = np.random.default_rng(10)
    matrix = np.vstack([np.eye(3), np.eye(3)]) + rng.uniform(-0.02, 0.02, (6, 3))
    bias, extra = rng.uniform(-1.0, 1.0, 6), np.zeros(6)
    chip = m.ImuChip(matrix, bias, rng.uniform(-0.01, 0.01, 6), extra)
    chip.rest_sigma_g, chip.moving_sigma_g, chip.sigma_deg_s = 0.004, 0.02, 0.05
    chip.walk_sigma_deg_s, chip.yaw_sigma_deg_s, chip.motion_deg_s = 0.001, 0.02, 0.1
    chip.lsb_accel, chip.lsb_gyro, chip.window_ms = 16384.0, 131.0, 19.6
    chip.ambient_c, chip.warming_c, chip.temperature_error_c = 25.0, 6.0, 0.3
    felt = np.zeros(8)
    chip.begin(*felt.tolist())
    given: list[object] = []
    for k in range(150):
        interval_ms = 10 if k % 10 else 7
        chip.interval_ms, chip.per_s = interval_ms, 1000.0 / interval_ms
        chip.per_g, chip.per_deg = chip.per_s / 9.80665, chip.per_s * 57.29577951308232
        extra[:] = 300.0 if k == 70 else 0.0  # beyond the sensor's range, so the sensor saturates
        felt += rng.uniform(0.0, 0.002, 8) * (k > 40)
        normals = rng.standard_normal(m.DRAWS + 3)
        given += m.sample(chip, normals, 3, 10.0 * k, *felt.tolist())
    assert 32767 in given
    return given


def ray_kernel(m: Any) -> list[object]:
    turned = np.linspace(-1.6, 1.6, 21)
    beams = np.array([(0.05, 0.01, math.cos(a), math.sin(a)) for a in turned.tolist()])
    ear = m.UltrasonicGeometry(0.12, 0.0, 0.1, 0.13, 0.891, 4.0, 1.5)
    given: list[object] = []
    for k in range(24):
        walker = np.array([1.0, 1.1, 0.1 * (k % 3)])
        pose = (0.3 + 0.05 * k, 0.3, 0.7 * k)
        hits = np.zeros((21, 3))
        m.cast_beams(ROOM, walker, *pose, beams, hits)
        given += [hits, m.echo(ROOM, walker, CORNERS, *pose, beams[6:15].copy(), ear)]
    return given


def carpets(m: Any) -> list[object]:
    plan = FloorPlan(
        "floor",
        tuple(box(0.0, 0.0, 2.0, 1.5)),
        (),
        Pose2(0.5, 0.5, 0.0),
        (
            Carpet(tuple(box(0.2, 0.2, 1.0, 1.0)), 1.2, 0.02),
            Carpet(tuple(box(0.6, 0.6, 1.4, 1.4)), 0.8, 0.99),
        ),
    )
    rows = m.carpet_rows(plan)
    given: list[object] = [rows]
    for k in range(60):
        given += m.carpet_under(0.1 + 0.021 * k, 0.9 - 0.009 * k, rows)
    return given


def thresholds(m: Any) -> list[object]:
    plan = FloorPlan(
        "floor",
        tuple(box(0.0, 0.0, 2.0, 1.5)),
        (),
        Pose2(0.5, 0.5, 0.0),
        (),
        (Threshold((0.7, 0.0), (0.7, 1.5), 0.003), Threshold((0.0, 0.9), (0.8, 1.5), 0.04)),
    )
    rows = m.threshold_rows(plan)
    stance, felt = m.Stance(0.23, 0.0325, 0.115, 0.015, 11.8, 5.9), m.Climb()
    given: list[object] = [rows]
    for k in range(60):
        m.climb(0.1 + 0.021 * k, 0.9 - 0.009 * k, 0.1 * k, stance, rows, felt)
        given += public(felt)
    return given


def fast_world_kernel(m: Any) -> list[object]:
    walls = ROOM[:, :4].copy()
    state, out = np.zeros(12), np.zeros(3)
    state[:3], state[7] = (0.5, 0.5, 0.3), 1.0
    given: list[object] = []
    for k in range(150):
        m.move(walls, state, 0.3 if k % 50 < 40 else -0.1, 0.4, 0.17, 1.518)
        m.sense(walls, CORNERS, state, out, 0.26, 0.12, 0.05, 0.10)
        given += [state.copy(), out.copy()]
    return given


IMU = CATALOGUE.spec(Imu).type_id


def damaged_stream(rng: np.random.Generator) -> bytes:
    """Return frames of all lengths, intact and damaged, with noise between them."""
    encoder = UartEncoder()
    stream = bytearray(b"\0\0\x02\0")
    for number in range(242):
        payload = (rng.integers(0, 256, number) * (rng.random(number) < 0.8)).astype(np.uint8)
        frame = bytearray(encoder.frame(0x10, 1, number & 0x7F, number, 1 << 31, payload.tobytes()))
        if number % 3 == 0:
            frame[int(rng.integers(0, len(frame)))] ^= 1 << int(rng.integers(0, 8))
        stream += frame
    return bytes(stream) + b"\x11" * 254 + b"\0" + b"\x11" * 300 + b"\0" + b"\xff" * 254 + b"\0"


def cut_up(data: bytes, rng: np.random.Generator) -> list[bytes]:
    """Return the bytes split into pieces at random places."""
    places = sorted({0, len(data), *rng.integers(0, len(data), 200).tolist()})
    return [data[a:b] for a, b in pairwise(places)]


def plain(event: Any) -> object:
    """Return a frame or damage in a form that does not depend on its class."""
    return tuple(value.value if isinstance(value, Enum) else value for value in event)


def framing(m: Any) -> list[object]:
    rng = np.random.default_rng(11)
    stream = damaged_stream(rng)
    parser = m.UartParser()
    given: list[object] = []
    for piece in cut_up(stream, rng):
        given += map(plain, parser.feed(piece))
        given.append((parser.bytes_seen, parser.frames, parser.damaged))
    assert parser.frames > 100
    assert parser.damaged > 50
    given += [m.encode_frame(15, 0x7E, 300, -1, bytes(size), 3) for size in (0, 1, 100, 241)]
    with pytest.raises(m.FrameSizeError):
        m.UartEncoder().frame(0x10, 1, 2, 3, 4, bytes(242))
    return given


def codec(m: Any) -> list[object]:
    one = m.Codec()
    imu, spec = Imu(-32768, 32767, 0, 1, -1, 300, -300), one.catalogue.spec(Imu)
    given = [one.encode(imu), one.encode(LogText(1, "äußerst")), one.shared_fields(spec)]
    given.append(tuple(one.decode(spec, given[0][1])))
    one.limit(spec.type_id, 3)
    given += [one.encode(imu), one.shared_fields(spec)]
    given += [tuple(one.decode(spec, bytes(size))) for size in (6, 14, 20)]
    one.limit(spec.type_id, None)
    given += [one.encode(imu), one.extra_bytes]
    for wrong in (Imu(1 << 20, 0, 0, 0, 0, 0, 0), Imu(0, 0, 0, 0, 0, 0, -32769)):
        with pytest.raises(FieldRangeError) as beyond:
            one.encode(wrong)
        given.append(str(beyond.value))
    for size in (0, 13, 15):
        with pytest.raises(PayloadError) as misfit:
            one.decode(spec, bytes(size))
        given.append(str(misfit.value))
    return given


def events_of(link: Any, pieces: list[bytes]) -> list[object]:
    """Return the events of a link for these bytes, and the link's statistics afterwards."""
    events = [event for piece in pieces for event in link.receive(piece, 0)]
    given: list[object] = []
    for event in events:
        if isinstance(event, Rejected):
            given.append((event.reason, tuple(event.frame)))
        elif hasattr(event, "spec"):
            given.append((event.spec.name, tuple(event.message), tuple(event.frame)))
        else:
            given.append(plain(event))
    return [*given, str(link.statistics)]


def uart_link(m: Any) -> list[object]:
    rng = np.random.default_rng(12)
    device, host = m.Link(Direction.DEVICE), m.Link(Direction.HOST)
    given: list[object] = []
    for number in range(300):
        values = rng.integers(-32768, 32768, 7).tolist()
        device.send(Imu(*values), number * 10_000, node=1 + number % 3, latest=number % 5 == 0)
        if number % 7 == 0:
            device.send(LogText(number % 3, f"line {number}"), number, node=1)
        if number % 2:
            given.append(device.data_to_send())
    stream = b"".join(data for data in given if isinstance(data, bytes))
    given += events_of(host, cut_up(stream + damaged_stream(rng), rng))
    host.forget_sequence()
    host.disabled.add(IMU)
    given += events_of(host, cut_up(stream, rng))
    host.send(VelocitySetpoint(1, -2, 200, 1), -5, node=2)
    host.send(Stop(1, 0), 1 << 33, node=0, flags=2)
    given += [host.has_data, host.data_to_send(), host.has_data, host.data_to_send()]
    return [*given, *events_of(device, [given[-3]])]  # type: ignore[list-item]


def link(m: Any) -> list[object]:
    base = m.LinkBase(Direction.DEVICE)
    given: list[object] = [base.send(Imu(*range(7)), 5, node=1), base.has_data]
    given += [base.send(Imu(*range(k, k + 7)), k, node=k % 2, latest=True) for k in range(9)]
    with pytest.raises(m.WrongDirectionError) as wrong:
        base.send(VelocitySetpoint(1, 2, 3, 4), 0, node=1)
    with pytest.raises(FieldRangeError) as beyond:
        base.send(Imu(*range(7)), 0, node=16)
    base.disabled.add(IMU)
    given += [str(wrong.value), str(beyond.value), base.send(Imu(*range(7)), 0, node=1)]
    given += [base.send_payload(IMU, b"", 0, 1), base.send_payload(3, b"abc", 9, 1)]
    return [*given, str(base.statistics)]


SCENARIOS: dict[str, Scenario] = {
    scenario.__name__: scenario
    for scenario in (
        *(evidence_kernels, lane_kernels, travel_kernels, window_kernels),
        *(raster_kernel, records_kernel, rows_kernel),
        *(drive_kernel, wheel_kernel, imu_kernel, ray_kernel, fast_world_kernel),
        *(carpets, thresholds),
    )
}


def flat(given: list[object]) -> list[float]:
    """Return all numbers of nested results as one list."""
    numbers: list[float] = []
    for value in given:
        if isinstance(value, np.ndarray):
            numbers += value.astype(np.float64).ravel().tolist()
        elif isinstance(value, tuple | list):
            numbers += flat([v for v in value if not isinstance(v, str)])
        else:
            numbers.append(float(value))  # type: ignore[arg-type]
    return numbers


def compiled(name: str) -> ModuleType:
    module = importlib.import_module(name.removeprefix("tests."))
    assert str(module.__file__).endswith(sysconfig.get_config_var("EXT_SUFFIX"))
    return module


MODULES: dict[str, Scenario] = {
    "protocol.link": link,
    "protocol.schema.codec": codec,
    "protocol.uart.framing": framing,
    "protocol.uart.link": uart_link,
}
"""Modules of plain Python with types in a .pxd file. All their results must be exactly equal."""

TYPED = {source for source in kernels.sources() if kernels.types(source).exists()}
IN_A_RUN = {kernels.module_name(source) for source in TYPED} - set(MODULES)
"""Further modules of plain Python. A simulated run compares them by the bytes of its log."""
RUN = """
import sys
if sys.argv[1] == ".py":
    import support.sources
from tools.cli.main import run
status = run(sys.argv[2].split())
print([name for name in sys.argv[3:] if not sys.modules[name].__file__.endswith(sys.argv[1])])
sys.exit(status)
"""
"""Program that runs a command and prints the modules whose files lack the given suffix."""


@pytest.mark.parametrize("name", sorted(MODULES))
def test_compiled_and_ordinary_give_the_same(name: str) -> None:
    expected = MODULES[name](load_pure(kernels.ROOT / f"{name.replace('.', '/')}.py"))
    assert len(expected) > 10
    assert MODULES[name](compiled(name)) == expected


@pytest.mark.parametrize(
    "options",
    [
        "--planner recovery --seed 3 --noise harsh --fault wheel-slip@20:6:share=0.5",
        "--planner paper --fault bit-flips@10:20:rate=0.001 --fault brown-out@35:off=0.5",
        "--planner random --supervise --fault latency@30:5:ms=60",
    ],
)
def test_a_run_is_the_same_with_compiled_and_with_ordinary_modules(
    options: str, tmp_path: Path
) -> None:
    logs: list[bytes] = []
    for suffix in (sysconfig.get_config_var("EXT_SUFFIX"), ".py"):
        folder = tmp_path / suffix[-2:]
        folder.mkdir()
        given = f"simulate two-rooms --max-time 60 {options} --out run.mcap"
        done = subprocess.run(
            [sys.executable, "-c", RUN, suffix, given, *sorted(IN_A_RUN)],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "tests")))},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.stdout.splitlines()[-1:] == ["[]"], done.stderr
        logs.append((folder / "run.mcap").read_bytes())
    assert len(logs[0]) > 500_000
    assert logs[0] == logs[1]


@pytest.mark.parametrize(
    "source", sorted({*kernels.sources(tests=True)} - TYPED), ids=kernels.module_name
)
def test_compiled_and_pure_give_the_same(source: Path) -> None:
    scenario = SCENARIOS[source.stem]
    expected = flat(scenario(load_pure(source)))
    assert len(expected) > 50
    assert len(set(expected)) > 5
    assert flat(scenario(compiled(kernels.module_name(source)))) == pytest.approx(
        expected, rel=TOLERANCE, abs=TOLERANCE, nan_ok=True
    )


def test_values_out_of_range_are_rejected() -> None:
    m: Any = compiled("bridge.coverage.recovery.evidence_kernels")
    layer = np.zeros((5, 6), np.uint8)
    for wrong in (layer.astype(np.int32), layer[0], layer.T, layer[:, ::2]):
        with pytest.raises(ValueError, match=r"Buffer|contiguous"):
            m.fresh_ahead(wrong, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0)
    with pytest.raises(TypeError, match="real number"):
        m.fresh_ahead(layer, "far", 0.0, 0.0, 0.0, 1.0, 0.0, 1.0)
    with pytest.raises(OverflowError):
        m.add_wall(layer, layer, 1 << 70, 0, 1, 1.0)
