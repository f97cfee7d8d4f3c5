"""Model of an ultrasonic ranger like the HC-SR04: echoes, timing and errors.

Source: HC-SR04 user's manual (ElecFreaks): 2 cm to 4 m, 15°, "over 60 ms measurement cycle". The
sensor's output pulse lasts 38 ms after a ping (sound pulse) without an echo.

**Echoes.** A surface that faces the sensor reflects the sound back. The model casts rays over the
cone; the nearest valid echo is the range:

- A wall gives an echo if the angle between its normal and the ray is at most ``SPECULAR_RAD``. At a
  larger angle the wall reflects the sound away, but still hides the objects behind it. If the angle
  between the normal and the sensor's axis exceeds ``SPECULAR_RAD`` plus half the cone, the sensor
  does not detect the wall.
- A visible corner in the cone gives an echo. A corner of the room always gives an echo, because its
  two walls reflect the sound back. A corner of an obstacle gives an echo only up to
  ``EDGE_ECHO_M``, because an edge reflects little sound.

Below the minimum range, the receiver still oscillates from the ping, and the reading is the minimum
range.

**Timing.** The firmware sends a ping every 60 ms from power-on, independent of reads. A range is
known when its echo arrives, after 6 ms per metre, or after 38 ms without an echo. Until then the
sensor returns the previous range. So a reading has an additional delay of up to 60 ms; at 0.20 m/s
the reading is then up to 12 mm too long. At 20 readings per second, one reading in six is an exact
repetition of the previous reading. The robot's place at a ping is interpolated linearly between two
readings.

**Errors** occur per ping, with the probabilities of the noise level. The sensor may miss an echo
and report free space. The sensor may also detect another sound as the echo (crosstalk): a late echo
of the previous ping, another robot's ping, or a reflection over a side wall. A crosstalk range is
drawn uniformly between minimum and maximum range. So the reading is too short if the floor ahead is
free, and mostly too long near a wall.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.geometry import Pose2, wrap_angle
from sim_device.world.ray_kernel import UltrasonicGeometry

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
"""Time of flight to the obstacle and back, ms per metre of range, at 20 °C."""
SPECULAR_RAD = math.radians(27.0)
"""Maximum angle between ray and wall normal that gives an echo, rad: 25-30° for painted walls at 40
kHz. At this wavelength (8.5 mm) a painted wall reflects like a mirror."""
EDGE_ECHO_M = 1.5
CONE_RAYS = 31
"""Number of rays in the cone. It is odd, so that one ray points straight ahead. In a cone of 15°
the rays are 0.5° apart. This detects a leg of 4 cm at 4 m, and the range of a wall that faces the
sensor is at most 10⁻⁵ (relative) too long."""
_COS_SPECULAR = math.cos(SPECULAR_RAD)


def beam(mount: RangerMount, off_axis_rad: float = 0.0) -> tuple[float, float, float, float]:
    """Return origin (m) and unit direction of a ray from a mount, in the body's frame."""
    bearing = mount.yaw_rad + off_axis_rad
    return mount.x_m, mount.y_m, math.cos(bearing), math.sin(bearing)


class Ultrasonic:
    """The ultrasonic ranger at its mount."""

    def __init__(self, mount: RangerMount, noise: NoiseLevel, draws: Draws) -> None:
        """Start without a range; no other object may use ``draws``."""
        self._mount, self._noise, self._draws = mount, noise, draws
        half_rad = 0.5 * mount.cone_rad
        fan = np.linspace(-half_rad, half_rad, CONE_RAYS).tolist()
        self._beams: Floats = np.array([beam(mount, off) for off in fan])
        ear = (mount.x_m, mount.y_m, mount.yaw_rad, half_rad, _COS_SPECULAR, mount.max_range_m)
        self._ear = UltrasonicGeometry(*ear, EDGE_ECHO_M)
        self._ping = -1
        self._before: tuple[int, Pose2] | None = None
        self._reported: float | None = None
        self.reported_ms = 0
        """True time of the ping that gave the reported range, ms."""
        self._coming: float | None = None
        self._ready_ms = 0.0

    def read(self, tick_ms: int, pose: Pose2, world: World) -> float | None:
        """Return the newest range known at this tick, m; ``None``: no echo.

        ``pose`` is the present pose. Times must not decrease between calls.
        """
        newest = tick_ms // CYCLE_MS
        if newest > self._ping:
            if newest - 1 > self._ping >= 0:
                self._fire(newest - 1, tick_ms, pose, world)
            self._fire(newest, tick_ms, pose, world)
        self._before = (tick_ms, pose)
        if tick_ms >= self._ready_ms:
            self._report()
        return self._reported

    def exact(self, pose: Pose2, world: World) -> float | None:
        """Return the range of a noise-free ping at ``pose``, m."""
        return _limited(world.echo_m(pose, self._beams, self._ear), self._mount)

    def _fire(self, ping: int, tick_ms: int, pose: Pose2, world: World) -> None:
        self._report()  # the cycle is longer than the longest time of flight
        self._ping = ping
        ping_ms = CYCLE_MS * ping
        self._coming = self._heard(self.exact(self._pose_at(ping_ms, tick_ms, pose), world))
        far_m = self._coming
        self._ready_ms = ping_ms + (NO_ECHO_MS if far_m is None else FLIGHT_MS_PER_M * far_m)

    def _report(self) -> None:
        """Make the newest ping's range the reported range."""
        self._reported = self._coming
        if self._ping >= 0:
            self.reported_ms = CYCLE_MS * self._ping

    def _pose_at(self, at_ms: int, tick_ms: int, pose: Pose2) -> Pose2:
        """Return the robot's pose at a ping between the last reading and now."""
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
