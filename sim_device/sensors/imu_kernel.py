"""Compiled kernel for one sample of the inertial sensor: motion, errors, filter, counts.

The axes are in the order of the registers: acceleration x, y, z (g), then rate x, y, z (°/s).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cython
import numpy as np
from cython.cimports.libc.math import exp, fabs

if TYPE_CHECKING or cython.compiled:
    from cython.cimports.bridge.motion.arrays import FloatGrid, Floats

if TYPE_CHECKING:
    Registers = tuple[int, int, int, int, int, int, int]

_DRAWS = cython.declare(cython.int, 10)
_ROWS = cython.declare(cython.int, 64)
_AXES = cython.declare(cython.int, 6)
DRAWS = _DRAWS
"""Number of normal random values per sample: six for the axes, three for the random walk of the
bias, one for the random walk of the angle.
"""
ROWS = _ROWS
"""Number of rows in the filter's memory. The longest window is 37 ms, and a row covers at least 1
ms.
"""
AXES = _AXES

_MOVING_RAD_S = cython.declare(cython.double, 0.05)
"""Minimum mean wheel speed at which motion noise is present, rad/s; 1.6 mm/s."""
WARMING_TIME_S = 300.0
_WARMING_TIME_S = cython.declare(cython.double, WARMING_TIME_S)
_TEMPERATURE_LSB_PER_C = cython.declare(cython.double, 340.0)
_TEMPERATURE_OFFSET_C = cython.declare(cython.double, 36.53)
_MIN = cython.declare(cython.double, -32768.0)
_MAX = cython.declare(cython.double, 32767.0)
_ROUNDS = cython.declare(cython.double, 6755399441055744.0)
"""Rounding constant 1.5 · 2⁵². Adding it to a small number rounds the number to an integer, and
halves to the nearest even integer."""


@cython.final
@cython.cclass
class ImuChip:
    """State of one chip: errors, configuration, random walk of the bias, last sample."""

    matrix: FloatGrid
    """Matrix from the true values to the values of each axis, with cross-axis terms; shape ``(6,
    3)``."""
    bias: Floats
    """Bias of each axis at the reference temperature, including faults."""
    tempco: Floats
    """Change of each axis' bias per °C."""
    extra: Floats
    """Offset added to the motion on each axis while a person lifts the robot."""
    rest_sigma_g = cython.declare(cython.double, visibility="public")
    """Sigma of the accelerometer's white noise in one row at rest, g."""
    moving_sigma_g = cython.declare(cython.double, visibility="public")
    sigma_deg_s = cython.declare(cython.double, visibility="public")
    """Sigma of the gyro's white noise in one row, °/s."""
    walk_sigma_deg_s = cython.declare(cython.double, visibility="public")
    yaw_sigma_deg_s = cython.declare(cython.double, visibility="public")
    motion_deg_s = cython.declare(cython.double, visibility="public")
    """Bias of the yaw rate while the robot moves, °/s."""
    lsb_accel = cython.declare(cython.double, visibility="public")
    """Scale of the accelerometer, counts per g."""
    lsb_gyro = cython.declare(cython.double, visibility="public")
    """Scale of the gyro, counts per °/s."""
    window_ms = cython.declare(cython.double, visibility="public")
    """Length of the filter's window, ms."""
    temperature_error_c = cython.declare(cython.double, visibility="public")
    ambient_c = cython.declare(cython.double, visibility="public")
    warming_c = cython.declare(cython.double, visibility="public")
    interval_ms = cython.declare(cython.double, visibility="public")
    per_s = cython.declare(cython.double, visibility="public")
    """Reciprocal of the sample interval, 1/s. The next attributes are this value divided by gravity
    (for results in g), and in degrees."""
    per_g = cython.declare(cython.double, visibility="public")
    per_deg = cython.declare(cython.double, visibility="public")
    # Inputs of the last call of ``sample``.
    heading_rad: cython.double
    impulse_x_m_s: cython.double
    impulse_y_m_s: cython.double
    left_rad: cython.double
    right_rad: cython.double
    pitch_rad: cython.double
    roll_rad: cython.double
    climb_m_s: cython.double
    walk: Floats
    """Present random walk of the gyro's bias, °/s."""
    durations_ms: Floats
    """Durations of the rows of the filter's memory, ms; 0: empty."""
    rows: FloatGrid
    """Mean values of the samples: one row of six axes per sample."""
    head: cython.int
    """Index of the next row."""
    mean: Floats
    """Output of the filter."""

    def __init__(self, matrix: FloatGrid, bias: Floats, tempco: Floats, extra: Floats) -> None:
        """Store references to the arrays; the caller may change their content later."""
        self.matrix, self.bias, self.tempco, self.extra = matrix, bias, tempco, extra
        self.walk, self.mean = np.zeros(3), np.zeros(AXES)
        self.durations_ms, self.rows, self.head = np.zeros(ROWS), np.zeros((ROWS, AXES)), 0
        self.rest_sigma_g = self.moving_sigma_g = self.sigma_deg_s = 0.0
        self.walk_sigma_deg_s = self.yaw_sigma_deg_s = self.motion_deg_s = 0.0
        self.lsb_accel = self.lsb_gyro = self.window_ms = self.temperature_error_c = 0.0
        self.ambient_c = self.warming_c = 0.0
        self.interval_ms = self.per_s = self.per_g = self.per_deg = 0.0
        self.begin(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def begin(  # noqa: PLR0913, PLR0917 - as ``sample``
        self,
        heading_rad: cython.double,
        impulse_x_m_s: cython.double,
        impulse_y_m_s: cython.double,
        left_rad: cython.double,
        right_rad: cython.double,
        pitch_rad: cython.double,
        roll_rad: cython.double,
        climb_m_s: cython.double,
    ) -> None:
        """Set the start values of the inputs, from which the next sample's means are computed."""
        self.heading_rad = heading_rad
        self.impulse_x_m_s, self.impulse_y_m_s = impulse_x_m_s, impulse_y_m_s
        self.left_rad, self.right_rad = left_rad, right_rad
        self.pitch_rad, self.roll_rad, self.climb_m_s = pitch_rad, roll_rad, climb_m_s


def sample(  # noqa: PLR0913, PLR0917 - single numbers, because a kernel takes them cheaply
    chip: ImuChip,
    normals: Floats,
    at: cython.Py_ssize_t,
    tick_ms: cython.double,
    heading_rad: cython.double,
    impulse_x_m_s: cython.double,
    impulse_y_m_s: cython.double,
    left_rad: cython.double,
    right_rad: cython.double,
    pitch_rad: cython.double,
    roll_rad: cython.double,
    climb_m_s: cython.double,
) -> Registers:
    """Add the mean motion since the last sample to the filter; return the registers.

    Args:
        chip: State of the chip; the function changes it.
        normals: Standard normal values; ``DRAWS`` values from index ``at`` are used.
        at: Index of the first value to use.
        tick_ms: Time since power-on, ms; it gives the temperature of the board.
        heading_rad: Heading. This value and the next ones are fields of ``truth.Inertial``. Their
            change since the last sample gives the mean motion.
        impulse_x_m_s: Specific impulse ahead.
        impulse_y_m_s: Specific impulse to the left.
        left_rad: Angle of the left wheel; motion noise is present while a wheel turns.
        right_rad: Angle of the right wheel.
        pitch_rad: Pitch, nose up, which is a negative turn about y.
        roll_rad: Roll, left side up.
        climb_m_s: Vertical speed, upwards.

    Returns:
        The seven registers in the chip's order, saturated.

    """
    per_g, per_deg = chip.per_g, chip.per_deg
    extra, matrix, rows = chip.extra, chip.matrix, chip.rows
    ax = (impulse_x_m_s - chip.impulse_x_m_s) * per_g + extra[0]
    ay = (impulse_y_m_s - chip.impulse_y_m_s) * per_g + extra[1]
    az = 1.0 + (climb_m_s - chip.climb_m_s) * per_g + extra[2]
    gx = (roll_rad - chip.roll_rad) * per_deg + extra[3]
    gy = (chip.pitch_rad - pitch_rad) * per_deg + extra[4]
    gz = (heading_rad - chip.heading_rad) * per_deg + extra[5]
    turned_rad = fabs(left_rad - chip.left_rad) + fabs(right_rad - chip.right_rad)
    moving: cython.bint = turned_rad * chip.per_s > 2.0 * _MOVING_RAD_S
    chip.heading_rad = heading_rad
    chip.impulse_x_m_s, chip.impulse_y_m_s = impulse_x_m_s, impulse_y_m_s
    chip.left_rad, chip.right_rad = left_rad, right_rad
    chip.pitch_rad, chip.roll_rad, chip.climb_m_s = pitch_rad, roll_rad, climb_m_s

    head = chip.head
    chip.head = (head + 1) % _ROWS
    chip.durations_ms[head] = chip.interval_ms
    sigma_g = chip.moving_sigma_g if moving else chip.rest_sigma_g
    for axis in range(3):
        true = matrix[axis, 0] * ax + matrix[axis, 1] * ay + matrix[axis, 2] * az
        rows[head, axis] = true + sigma_g * normals[at + axis]
    for axis in range(3, 6):
        true = matrix[axis, 0] * gx + matrix[axis, 1] * gy + matrix[axis, 2] * gz
        rows[head, axis] = true + chip.sigma_deg_s * normals[at + axis]
    for axis in range(3):
        chip.walk[axis] += chip.walk_sigma_deg_s * normals[at + 6 + axis]
        rows[head, 3 + axis] += chip.walk[axis]
    if moving:
        rows[head, 5] += chip.motion_deg_s + chip.yaw_sigma_deg_s * normals[at + 9]

    _filter(chip, head)
    warm_c = chip.warming_c * (1.0 - exp(-0.001 * tick_ms / _WARMING_TIME_S))
    temperature_c = chip.ambient_c + warm_c + chip.temperature_error_c
    return (
        _axis(chip, 0, warm_c, chip.lsb_accel),
        _axis(chip, 1, warm_c, chip.lsb_accel),
        _axis(chip, 2, warm_c, chip.lsb_accel),
        _counts((temperature_c - _TEMPERATURE_OFFSET_C) * _TEMPERATURE_LSB_PER_C),
        _axis(chip, 3, warm_c, chip.lsb_gyro),
        _axis(chip, 4, warm_c, chip.lsb_gyro),
        _axis(chip, 5, warm_c, chip.lsb_gyro),
    )


@cython.cfunc
@cython.exceptval(check=False)
def _filter(chip: ImuChip, head: cython.int) -> cython.void:
    """Compute the running mean over the window that ends with the row ``head``.

    If the window begins within a row, the result is a weighted mean of the means with and without
    this row. The weights make the delay exactly half of the window.
    """
    mean, rows, durations_ms = chip.mean, chip.rows, chip.durations_ms
    window_ms, taken_ms, share = chip.window_ms, 0.0, 1.0
    past: cython.int = head
    for axis in range(_AXES):
        mean[axis] = 0.0
    for _ in range(_ROWS):
        duration_ms = durations_ms[past]
        if taken_ms > 0.0:
            share = min(1.0, (window_ms - taken_ms) / duration_ms)
        weight = share * duration_ms / (taken_ms + duration_ms)
        for axis in range(_AXES):
            mean[axis] += weight * (rows[past, axis] - mean[axis])
        taken_ms += duration_ms
        past = past - 1 if past else _ROWS - 1
        if taken_ms >= window_ms or durations_ms[past] == 0.0:
            break


@cython.cfunc
@cython.exceptval(check=False)
def _axis(chip: ImuChip, axis: cython.int, warm_c: cython.double, lsb: cython.double) -> cython.int:
    """Return the register of one axis."""
    return _counts((chip.mean[axis] + chip.bias[axis] + warm_c * chip.tempco[axis]) * lsb)


@cython.cfunc
@cython.exceptval(check=False)
def _counts(value: cython.double) -> cython.int:
    """Round to a register value, with saturation as in the chip."""
    return int((min(_MAX, max(_MIN, value)) + _ROUNDS) - _ROUNDS)
