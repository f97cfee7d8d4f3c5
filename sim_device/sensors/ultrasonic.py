"""HC-SR04-like ultrasonic ranger: what it hears and when.

Source: HC-SR04 user's manual (ElecFreaks): 2 cm to 4 m, 15°, "over 60 ms measurement cycle";
a ping that brings no echo holds its output for 38 ms.

**What echoes.** Sound comes back from what faces the sensor. Rays fan out over the cone; the
nearest that counts gives the range:

- a ray that meets a wall within ``SPECULAR_RAD`` of square on echoes; beyond, the wall is a
  mirror and the sound is gone, though the wall still hides what lies behind it. A wall aslant
  by more than that and half the cone is not seen at all;
- a corner in the cone and in sight echoes: one in which the floor ends (a room's corner)
  always, as its two walls send sound back; one that juts into the floor only within
  ``EDGE_ECHO_M``, as an edge scatters little.

Closer than the least range the receiver still rings from the ping: it reads the least range.

**When.** The firmware pings every 60 ms from power-on, whoever reads or not. A range is known
when its echo is back, 6 ms later per metre, or after 38 ms without one; until then the last
one stands. A reading is therefore up to 60 ms and its own flight old: at 0.20 m/s up to 12 mm
too long. Read at 20 Hz, one reading in six repeats the one before to the bit. Where the robot
was at a ping is taken to lie on the straight way between two readings.

**What goes wrong**, per ping by the level's probabilities: an echo is missed, and there seems
to be nothing; or another sound is taken for the echo (crosstalk: a late echo of the last ping,
another robot's, one that came by way of a side wall), and the range is anything between the
least and the greatest: too short where the floor ahead is free, mostly too long near a wall.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.geometry import Pose2, wrap_angle
from sim_device.world.ray_kernel import Ear

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.motion.robot_model import RangerMount
    from sim_device.noise import Draws, NoiseLevel
    from sim_device.world.world import World

    Floats = NDArray[np.float64]

CYCLE_MS = 60
"""Period of the pings, ms."""
NO_ECHO_MS = 38.0
FLIGHT_MS_PER_M = 2000.0 / 343.0
"""There and back at 20 °C."""
SPECULAR_RAD = math.radians(27.0)
"""Greatest angle between sound and wall normal that still echoes: the 25-30° of painted
walls at 40 kHz, where the wavelength (8.5 mm) makes them mirrors."""
EDGE_ECHO_M = 1.5
CONE_RAYS = 31
"""Rays of the cone. Odd, so that one faces straight ahead; 0.5° apart in a cone of 15°. A leg of 4
cm is seen at 4 m, and a wall normal to some direction in the cone reads at most 10⁻⁵ of its
range too far."""
_COS_SPECULAR = math.cos(SPECULAR_RAD)


def beam(mount: RangerMount, off_axis_rad: float = 0.0) -> tuple[float, float, float, float]:
    """Origin (m) and unit direction of a ray of a mount, in the body's frame."""
    bearing = mount.yaw_rad + off_axis_rad
    return mount.x_m, mount.y_m, math.cos(bearing), math.sin(bearing)


class Ultrasonic:
    """The ranger at its mount."""

    def __init__(self, mount: RangerMount, noise: NoiseLevel, draws: Draws) -> None:
        """``draws`` is its own; nothing is heard before the first echo is back."""
        self._mount, self._noise, self._draws = mount, noise, draws
        half_rad = 0.5 * mount.cone_rad
        fan = np.linspace(-half_rad, half_rad, CONE_RAYS).tolist()
        self._beams: Floats = np.array([beam(mount, off) for off in fan])
        ear = (mount.x_m, mount.y_m, mount.yaw_rad, half_rad, _COS_SPECULAR, mount.max_range_m)
        self._ear = Ear(*ear, EDGE_ECHO_M)
        self._ping = -1
        self._before: tuple[int, Pose2] | None = None
        self._reported: float | None = None
        self._coming: float | None = None
        self._ready_ms = 0.0

    def read(self, tick_ms: int, pose: Pose2, world: World) -> float | None:
        """Newest range in metres that is known at this tick; ``None``: no echo.

        ``pose`` is the robot's now; times must not go back.
        """
        newest = tick_ms // CYCLE_MS
        if newest > self._ping:
            if newest - 1 > self._ping >= 0:
                self._fire(newest - 1, tick_ms, pose, world)
            self._fire(newest, tick_ms, pose, world)
        self._before = (tick_ms, pose)
        if tick_ms >= self._ready_ms:
            self._reported = self._coming
        return self._reported

    def exact(self, pose: Pose2, world: World) -> float | None:
        """Range that a ping at ``pose`` without any noise would give."""
        return _limited(world.echo_m(pose, self._beams, self._ear), self._mount)

    def _fire(self, ping: int, tick_ms: int, pose: Pose2, world: World) -> None:
        self._reported = self._coming  # a cycle is longer than any flight
        self._ping = ping
        ping_ms = CYCLE_MS * ping
        self._coming = self._heard(self.exact(self._pose_at(ping_ms, tick_ms, pose), world))
        far_m = self._coming
        self._ready_ms = ping_ms + (NO_ECHO_MS if far_m is None else FLIGHT_MS_PER_M * far_m)

    def _pose_at(self, at_ms: int, tick_ms: int, pose: Pose2) -> Pose2:
        """Where the robot was at a ping since the last reading."""
        if self._before is None or at_ms == tick_ms:
            return pose
        before_ms, was = self._before
        share = (at_ms - before_ms) / (tick_ms - before_ms)
        return Pose2(
            was.x_m + share * (pose.x_m - was.x_m),
            was.y_m + share * (pose.y_m - was.y_m),
            was.theta_rad + share * wrap_angle(pose.theta_rad - was.theta_rad),
        )

    def _heard(self, exact_m: float | None) -> float | None:
        noise, draws, mount = self._noise, self._draws, self._mount
        # Every ping draws the same number of values, whatever is in front of it.
        shift_m = noise.ultrasonic_sigma_m * draws.normal()
        missed = draws.uniform() < noise.ultrasonic_dropout
        strange = draws.uniform() < noise.ultrasonic_crosstalk
        where = draws.uniform()
        if strange:
            return mount.min_range_m + where * (mount.max_range_m - mount.min_range_m)
        if exact_m is None or missed:
            return None
        return _limited(exact_m + shift_m, mount)


def _limited(range_m: float, mount: RangerMount) -> float | None:
    if range_m > mount.max_range_m:
        return None
    return max(range_m, mount.min_range_m)
