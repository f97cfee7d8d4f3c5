"""The front ultrasonic and the two side infrared sensors, read together."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sim_device.noise import Draws
from sim_device.sensors.infrared import Infrared, Reflectances
from sim_device.sensors.ultrasonic import Ultrasonic, beam
from sim_device.world.ray_kernel import HIT_EDGE, HIT_RANGE

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel
    from sim_device.noise import NoiseLevel
    from sim_device.world.world import World


class Ranges(NamedTuple):
    """One reading of all three sensors, m; ``None``: no echo, or nothing in range."""

    ultrasonic_m: float | None
    infrared_left_m: float | None
    infrared_right_m: float | None
    ultrasonic_age_us: int
    """Time since the pulse of the ultrasonic range, µs; infrared ranges have no delay."""


class Rangers:
    """All range sensors of the robot."""

    def __init__(self, model: RobotModel, noise: NoiseLevel, rng: np.random.Generator) -> None:
        """Use the mounts of ``model``; ``rng`` spawns a generator for each ranger."""
        sonar, light, paint = (Draws(child) for child in rng.spawn(3))
        self.ultrasonic = Ultrasonic(model.ultrasonic, noise, sonar)
        self.reflectances = Reflectances(noise, paint)
        self._left = Infrared(model.infrared_left, noise, light, self.reflectances)
        self._right = Infrared(model.infrared_right, noise, light, self.reflectances)
        self._beams = np.array([beam(model.infrared_left), beam(model.infrared_right)])
        self._hits = np.empty((2, 3))
        self._has_ultrasonic = model.ultrasonic.fitted
        self._has_left, self._has_right = model.infrared_left.fitted, model.infrared_right.fitted

    def read(self, tick_ms: int, pose: Pose2, world: World) -> Ranges:
        """Return the range from each sensor's face at this tick, m.

        The infrared sensors measure now; the ultrasonic sensor returns the result of its last
        completed ping. Times must not decrease between calls.
        """
        ultrasonic_m = self.ultrasonic.read(tick_ms, pose, world)
        hits = self._hits
        world.cast_beams(pose, self._beams, hits)
        left, right = hits.tolist()
        return Ranges(
            ultrasonic_m if self._has_ultrasonic else None,
            self._left.reading(left[HIT_RANGE], int(left[HIT_EDGE])) if self._has_left else None,
            self._right.reading(right[HIT_RANGE], int(right[HIT_EDGE]))
            if self._has_right
            else None,
            1000 * (tick_ms - self.ultrasonic.reported_ms),
        )
