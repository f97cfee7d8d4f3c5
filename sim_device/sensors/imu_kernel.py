"""One sample of the inertial sensor, compiled: what is felt, its errors, filter and counts.

All arrays are float64 and are laid out by the constants here. Axes in the order of the
registers: acceleration x, y, z (g), then rate x, y, z (°/s).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.compiled import compiled

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Registers = tuple[int, int, int, int, int, int, int]

DRAWS = 10
"""Normal values that a sample takes: six axes, three walks of the bias, one of the angle."""
ROWS = 64
"""Of the filter's memory: its widest window is 37 ms, a row is at least 1 ms."""
AXES = 6
_ROW = 1 + AXES
"""Duration (ms) and means of what was sampled."""

# Layout of the chip's array: what was drawn or configured, the walks, and what was before.
MATRIX = 0
"""Six rows of three: how much of each axis' true value an axis shows, cross-axis included."""
BIAS = 18
"""Per axis at the reference temperature, faults included."""
TEMPCO = 24
"""Per axis, change of the bias per °C."""
SIGMA = 30
"""Per axis, of the white noise of one row, at rest."""
MOVING_SIGMA = 36
WALK_SIGMA = 42
YAW_SIGMA = 43
MOTION_DEG_S = 44
WALK = 45
"""Three: the gyro's bias, walked so far."""
LSB_ACCEL = 48
LSB_GYRO = 49
WINDOW_MS = 50
TEMPERATURE_ERROR_C = 51
AMBIENT_C = 52
WARMING_C = 53
HEAD = 54
EXTRA = 55
"""Six: added to what is felt (a lift)."""
INTERVAL_MS = 61
PER_S = 62
"""One over the interval; then the same over gravity (for g), and in degrees."""
PER_G = 63
PER_DEG = 64
BEFORE = 65
"""Eight: what ``sample`` was told the last time, from the heading on."""
MEAN = 73
"""Six: room for the filter's output."""
MEMORY = 79
SIZE = MEMORY + ROWS * _ROW

MOVING_RAD_S = 0.05
"""Mean wheel speed above which motion's own errors are present; 1.6 mm/s."""
WARMING_TIME_S = 300.0
TEMPERATURE_LSB_PER_C = 340.0
TEMPERATURE_OFFSET_C = 36.53
_MIN, _MAX = -32768.0, 32767.0


@compiled
def sample(  # noqa: PLR0913, PLR0917 - numbers, one by one: what a kernel takes cheaply
    chip: Floats,
    normals: Floats,
    at: int,
    tick_ms: float,
    heading_rad: float,
    impulse_x_m_s: float,
    impulse_y_m_s: float,
    left_rad: float,
    right_rad: float,
    pitch_rad: float,
    roll_rad: float,
    climb_m_s: float,
) -> Registers:
    """Take the means since the last sample into the filter and give the registers.

    Args:
        chip: Constants, walks and the filter's memory, shape ``(SIZE,)``; changed.
        normals: Standard normal values; ``DRAWS`` from ``at`` are taken.
        at: See ``normals``.
        tick_ms: Since power-on: how far the board has warmed.
        heading_rad: From here on as in ``truth.Inertial``, whose differences are means.
        impulse_x_m_s: See there, as all below.
        impulse_y_m_s: To the left.
        left_rad: The wheels' angles: motion's own errors are present while they turn.
        right_rad: See ``left_rad``.
        pitch_rad: Nose up, which is backwards about y.
        roll_rad: Left side up.
        climb_m_s: Upwards.

    Returns:
        The seven registers in the chip's order, saturated.

    """
    per_g, per_deg = chip[PER_G], chip[PER_DEG]
    ax = (impulse_x_m_s - chip[BEFORE + 1]) * per_g + chip[EXTRA]
    ay = (impulse_y_m_s - chip[BEFORE + 2]) * per_g + chip[EXTRA + 1]
    az = 1.0 + (climb_m_s - chip[BEFORE + 7]) * per_g + chip[EXTRA + 2]
    gx = (roll_rad - chip[BEFORE + 6]) * per_deg + chip[EXTRA + 3]
    gy = (chip[BEFORE + 5] - pitch_rad) * per_deg + chip[EXTRA + 4]
    gz = (heading_rad - chip[BEFORE]) * per_deg + chip[EXTRA + 5]
    turned_rad = abs(left_rad - chip[BEFORE + 3]) + abs(right_rad - chip[BEFORE + 4])
    moving = turned_rad * chip[PER_S] > 2.0 * MOVING_RAD_S
    chip[BEFORE], chip[BEFORE + 1], chip[BEFORE + 2] = heading_rad, impulse_x_m_s, impulse_y_m_s
    chip[BEFORE + 3], chip[BEFORE + 4] = left_rad, right_rad
    chip[BEFORE + 5], chip[BEFORE + 6], chip[BEFORE + 7] = pitch_rad, roll_rad, climb_m_s

    head = int(chip[HEAD])
    row = MEMORY + _ROW * head
    chip[HEAD] = (head + 1) % ROWS
    chip[row] = chip[INTERVAL_MS]
    for axis in range(AXES):
        p, q, r = (ax, ay, az) if axis < 3 else (gx, gy, gz)  # noqa: PLR2004 - axes of space
        m = MATRIX + 3 * axis
        sigma = chip[MOVING_SIGMA + axis] if moving else chip[SIGMA + axis]
        true = chip[m] * p + chip[m + 1] * q + chip[m + 2] * r
        chip[row + 1 + axis] = true + sigma * normals[at + axis]
    for axis in range(3):
        chip[WALK + axis] += chip[WALK_SIGMA] * normals[at + 6 + axis]
        chip[row + 4 + axis] += chip[WALK + axis]
    if moving:
        chip[row + 6] += chip[MOTION_DEG_S] + chip[YAW_SIGMA] * normals[at + 9]

    _filter(chip, head)
    warm_c = chip[WARMING_C] * (1.0 - math.exp(-0.001 * tick_ms / WARMING_TIME_S))
    temperature_c = chip[AMBIENT_C] + warm_c + chip[TEMPERATURE_ERROR_C]
    return (
        _axis(chip, 0, warm_c, chip[LSB_ACCEL]),
        _axis(chip, 1, warm_c, chip[LSB_ACCEL]),
        _axis(chip, 2, warm_c, chip[LSB_ACCEL]),
        _counts((temperature_c - TEMPERATURE_OFFSET_C) * TEMPERATURE_LSB_PER_C),
        _axis(chip, 3, warm_c, chip[LSB_GYRO]),
        _axis(chip, 4, warm_c, chip[LSB_GYRO]),
        _axis(chip, 5, warm_c, chip[LSB_GYRO]),
    )


@compiled
def _filter(chip: Floats, head: int) -> None:
    """Fill in the running mean over the window that ends with the row ``head``.

    Where its end lies within a row, the means with and without that row are mixed so that the
    delay is half the window to the dot.
    """
    window_ms, taken_ms, share = chip[WINDOW_MS], 0.0, 1.0
    for axis in range(AXES):
        chip[MEAN + axis] = 0.0
    for back in range(ROWS):
        past = MEMORY + _ROW * ((head - back) % ROWS)
        duration_ms = chip[past]
        if taken_ms > 0.0:
            share = min(1.0, (window_ms - taken_ms) / duration_ms)
        weight = share * duration_ms / (taken_ms + duration_ms)
        for axis in range(AXES):
            chip[MEAN + axis] += weight * (chip[past + 1 + axis] - chip[MEAN + axis])
        taken_ms += duration_ms
        if taken_ms >= window_ms or chip[MEMORY + _ROW * ((head - back - 1) % ROWS)] == 0.0:
            break


@compiled
def _axis(chip: Floats, axis: int, warm_c: float, lsb: float) -> int:
    """Give the register of one axis."""
    return _counts((chip[MEAN + axis] + chip[BIAS + axis] + warm_c * chip[TEMPCO + axis]) * lsb)


@compiled
def _counts(value: float) -> int:
    """Round to a register, saturating as the chip does."""
    return int(round(min(_MAX, max(_MIN, value))))  # noqa: RUF046 - of a float, a float here
