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

# Layout of the chip's array: what was drawn or configured, and the walks.
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
SIZE = 61

WARMING_TIME_S = 300.0
TEMPERATURE_LSB_PER_C = 340.0
TEMPERATURE_OFFSET_C = 36.53
_MIN, _MAX = -32768.0, 32767.0


@compiled
def sample(  # noqa: PLR0913, PLR0917 - numbers, one by one: what a kernel takes cheaply
    chip: Floats,
    rows: Floats,
    mean: Floats,
    normals: Floats,
    at: int,
    elapsed_ms: float,
    tick_ms: float,
    accel_x_g: float,
    accel_y_g: float,
    accel_z_g: float,
    roll_deg_s: float,
    pitch_deg_s: float,
    yaw_deg_s: float,
    moving: bool,  # noqa: FBT001 - as above
) -> Registers:
    """Take the means since the last sample into the filter and give the registers.

    Args:
        chip: Constants and walks, shape ``(SIZE,)``; the walks move on.
        rows: The filter's memory, shape ``(ROWS, 1 + AXES)``: duration (ms) and means.
        mean: Room for the filter's output, shape ``(AXES,)``.
        normals: Standard normal values; ``DRAWS`` from ``at`` are taken.
        at: See ``normals``.
        elapsed_ms: Since the last sample.
        tick_ms: Since power-on: how far the board has warmed.
        accel_x_g: Mean specific force ahead since the last sample.
        accel_y_g: To the left.
        accel_z_g: Upwards: 1 at rest.
        roll_deg_s: Mean rate about x (ahead), right-handed.
        pitch_deg_s: About y (left).
        yaw_deg_s: About z (up).
        moving: Whether the wheels turned: motion's own errors are present.

    Returns:
        The seven registers in the chip's order, saturated.

    """
    head = int(chip[HEAD])
    row = rows[head]
    chip[HEAD] = (head + 1) % ROWS
    ax, ay, az = accel_x_g + chip[EXTRA], accel_y_g + chip[EXTRA + 1], accel_z_g + chip[EXTRA + 2]
    gx, gy = roll_deg_s + chip[EXTRA + 3], pitch_deg_s + chip[EXTRA + 4]
    gz = yaw_deg_s + chip[EXTRA + 5]
    row[0] = elapsed_ms
    for axis in range(AXES):
        p, q, r = (ax, ay, az) if axis < 3 else (gx, gy, gz)  # noqa: PLR2004 - axes of space
        m = MATRIX + 3 * axis
        sigma = chip[MOVING_SIGMA + axis] if moving else chip[SIGMA + axis]
        row[1 + axis] = chip[m] * p + chip[m + 1] * q + chip[m + 2] * r + sigma * normals[at + axis]
    for axis in range(3):
        chip[WALK + axis] += chip[WALK_SIGMA] * normals[at + 6 + axis]
        row[4 + axis] += chip[WALK + axis]
    if moving:
        row[6] += chip[MOTION_DEG_S] + chip[YAW_SIGMA] * normals[at + 9]

    warm_c = chip[WARMING_C] * (1.0 - math.exp(-0.001 * tick_ms / WARMING_TIME_S))
    # The running mean over the window; where its end lies within a row, the means with and
    # without that row are mixed so that the delay is half the window to the dot.
    window_ms, taken_ms, share = chip[WINDOW_MS], 0.0, 1.0
    for axis in range(AXES):
        mean[axis] = 0.0
    for back in range(ROWS):
        past = rows[(head - back) % ROWS]
        duration_ms = past[0]
        if taken_ms > 0.0:
            share = min(1.0, (window_ms - taken_ms) / duration_ms)
        weight = share * duration_ms / (taken_ms + duration_ms)
        for axis in range(AXES):
            mean[axis] += weight * (past[1 + axis] - mean[axis])
        taken_ms += duration_ms
        if taken_ms >= window_ms or rows[(head - back - 1) % ROWS, 0] == 0.0:
            break
    accel, gyro = chip[LSB_ACCEL], chip[LSB_GYRO]
    temperature_c = chip[AMBIENT_C] + warm_c + chip[TEMPERATURE_ERROR_C]
    return (
        _counts((mean[0] + chip[BIAS] + warm_c * chip[TEMPCO]) * accel),
        _counts((mean[1] + chip[BIAS + 1] + warm_c * chip[TEMPCO + 1]) * accel),
        _counts((mean[2] + chip[BIAS + 2] + warm_c * chip[TEMPCO + 2]) * accel),
        _counts((temperature_c - TEMPERATURE_OFFSET_C) * TEMPERATURE_LSB_PER_C),
        _counts((mean[3] + chip[BIAS + 3] + warm_c * chip[TEMPCO + 3]) * gyro),
        _counts((mean[4] + chip[BIAS + 4] + warm_c * chip[TEMPCO + 4]) * gyro),
        _counts((mean[5] + chip[BIAS + 5] + warm_c * chip[TEMPCO + 5]) * gyro),
    )


@compiled
def _counts(value: float) -> int:
    """Round to a register, saturating as the chip does."""
    return int(round(min(_MAX, max(_MIN, value))))  # noqa: RUF046 - of a float, a float here
