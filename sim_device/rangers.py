"""The front ultrasonic and the two side infrared sensors.

Ultrasonic (HC-SR04-like): sound comes back from what faces the sensor. Rays fan out over the
cone; the nearest that counts gives the reading:

- a ray that meets a wall within ``SPECULAR_RAD`` of square on echoes; beyond, the wall is a
  mirror and the sound is gone, though the wall still hides what lies behind it;
- a corner in the cone and in sight echoes: one in which the floor ends (a room's corner)
  always, as its two walls send sound back; one that juts into the floor only within
  ``EDGE_ECHO_M``, as an edge scatters little.

Closer than the least range the receiver still rings: it reads the least range.

Infrared (triangulating): one beam, diffuse, any angle; nothing beyond its range; closer than
its least range it reads the least range.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RangerMount, RobotModel
    from sim_device.noise import Draws, NoiseLevel
    from sim_device.world import World

    Floats = NDArray[np.float64]

SPECULAR_RAD = math.radians(27.0)
"""Greatest angle between sound and wall normal that still echoes: the 25-30° of painted
walls at 40 kHz, where the wavelength (8.5 mm) makes them mirrors."""
EDGE_ECHO_M = 1.5
CONE_RAYS = 9
"""Odd, so that one goes straight ahead; 1.9° apart in a cone of 15°."""
_COS_SPECULAR = math.cos(SPECULAR_RAD)
_IN_SIGHT_M = 1e-6
_SIGMA_AT_M = 0.10
_SIGMA_FLOOR = 0.36
"""Of the infrared's sigma at 10 cm: reached at 6 cm."""


class Ranges(NamedTuple):
    """One reading of all three; ``None``: no echo, nothing in range."""

    ultrasonic_m: float | None
    infrared_left_m: float | None
    infrared_right_m: float | None


class Rangers:
    """All range sensors of the robot, cast together."""

    def __init__(self, model: RobotModel, noise: NoiseLevel, draws: Draws) -> None:
        """Take mounts from ``model``; ``draws`` is the rangers' own."""
        self._noise = noise
        self._draws = draws
        self._sonar = model.ultrasonic
        self._left, self._right = model.infrared_left, model.infrared_right
        half = 0.5 * self._sonar.cone_rad
        fan = np.linspace(-half, half, CONE_RAYS) + self._sonar.yaw_rad
        mounts = [self._sonar] * CONE_RAYS + [self._left, self._right]
        # In the body frame, as complex numbers: one product turns them into the room's.
        self._origin = np.array([complex(m.x_m, m.y_m) for m in mounts])
        self._direction = np.exp(
            1j * np.concatenate([fan, [self._left.yaw_rad, self._right.yaw_rad]]),
        )
        self._cos2_half = math.cos(half) ** 2

    def read(self, pose: Pose2, world: World) -> Ranges:
        """Range from each sensor's face, metres, with this level's noise."""
        sonar, left, right = self.exact(pose, world)
        noise, draws = self._noise, self._draws
        # Every reading draws the same number of values, whatever is in front of it.
        shift = noise.ultrasonic_sigma_m * draws.normal()
        dropped = draws.uniform() < noise.ultrasonic_dropout
        if sonar is not None:
            sonar = None if dropped else _limited(sonar + shift, self._sonar)
        return Ranges(
            sonar,
            self._infrared(left, self._left, draws.normal()),
            self._infrared(right, self._right, draws.normal()),
        )

    def exact(self, pose: Pose2, world: World) -> Ranges:
        """Range from each sensor's face as noise-free sensors would read it."""
        turn = complex(math.cos(pose.theta_rad), math.sin(pose.theta_rad))
        origin = complex(pose.x_m, pose.y_m) + turn * self._origin
        direction = turn * self._direction
        ranges, cos_incidence = world.cast(origin.real, origin.imag, direction.real, direction.imag)
        hits = ranges.tolist()
        nearest = min(
            (
                hit
                for hit, cosine in zip(hits[:CONE_RAYS], cos_incidence.tolist(), strict=False)
                if cosine >= _COS_SPECULAR
            ),
            default=math.inf,
        )
        corner_m = self._corner(
            complex(origin[0]), complex(direction[CONE_RAYS // 2]), nearest, world
        )
        return Ranges(
            _limited(min(nearest, corner_m), self._sonar),
            _limited(hits[CONE_RAYS], self._left),
            _limited(hits[CONE_RAYS + 1], self._right),
        )

    def _corner(self, origin: complex, ahead: complex, nearest_m: float, world: World) -> float:
        """Distance of the nearest corner in the cone that echoes; ``inf``: none that matters."""
        to_x, to_y = world.corner_x_m - origin.real, world.corner_y_m - origin.imag
        along = to_x * ahead.real + to_y * ahead.imag
        far2 = to_x * to_x + to_y * to_y
        seen = np.flatnonzero(
            (along > 0.0) & (along * along >= self._cos2_half * far2) & (far2 < nearest_m**2),
        )
        if not len(seen):
            return math.inf
        far = np.sqrt(far2[seen])
        seen_in_range = far <= np.where(
            world.corner_juts[seen], EDGE_ECHO_M, self._sonar.max_range_m
        )
        seen, far = seen[seen_in_range], far[seen_in_range]
        if not len(seen):
            return math.inf
        hits, _ = world.cast(
            np.full(len(seen), origin.real),
            np.full(len(seen), origin.imag),
            to_x[seen] / far,
            to_y[seen] / far,
        )
        in_sight = far[hits >= far - _IN_SIGHT_M]
        return float(in_sight.min()) if len(in_sight) else math.inf

    def _infrared(self, exact_m: float | None, mount: RangerMount, normal: float) -> float | None:
        if exact_m is None:
            return None
        growth = max(_SIGMA_FLOOR, (exact_m / _SIGMA_AT_M) ** 2)
        return _limited(exact_m + self._noise.infrared_sigma_m * growth * normal, mount)


def _limited(range_m: float, mount: RangerMount) -> float | None:
    if range_m > mount.max_range_m:
        return None
    return max(range_m, mount.min_range_m)
