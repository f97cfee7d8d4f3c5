"""Replacements of the plant with a motion given by a formula, so the sensor output is known."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from bridge.motion.geometry import Pose2
from sim_device.body.truth import Inertial

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim_device.body.plant import Plant
    from sim_device.world.world import World


def _still(_t_s: float) -> float:
    return 0.0


class Scripted:
    """A body for tests of the inertial sensor: heading and impulses are functions of time."""

    def __init__(  # noqa: PLR0913, PLR0917 - all inputs of a sensor, each with a default
        self,
        heading_deg: Callable[[float], float] = _still,
        impulse_x_m_s: Callable[[float], float] = _still,
        wheels_rad: Callable[[float], float] = _still,
        pitch_rad: Callable[[float], float] = _still,
        roll_rad: Callable[[float], float] = _still,
        climb_m_s: Callable[[float], float] = _still,
    ) -> None:
        self.tick_ms = 0
        self._heading_deg = heading_deg
        self._impulse_x_m_s = impulse_x_m_s
        self._wheels_rad = wheels_rad
        self._pitch_rad, self._roll_rad, self._climb_m_s = pitch_rad, roll_rad, climb_m_s

    @property
    def plant(self) -> Plant:
        """Return itself, in the type that a sensor expects."""
        return cast("Plant", self)

    @property
    def inertial(self) -> Inertial:
        t_s = 0.001 * self.tick_ms
        wheel = self._wheels_rad(t_s)
        return Inertial(
            self.tick_ms,
            self._heading_deg(t_s) * 0.017453292519943295,
            self._impulse_x_m_s(t_s),
            0.0,
            wheel,
            wheel,
            self._pitch_rad(t_s),
            self._roll_rad(t_s),
            self._climb_m_s(t_s),
        )


class Placed:
    """A body for tests of the bumper and cliff sensors, at a pose that the test sets."""

    def __init__(self, world: World, pose: Pose2 | None = None) -> None:
        self.world = world
        self.pose = pose or world.plan.start
        self.touch_bearings_rad: tuple[float, ...] = ()

    @property
    def plant(self) -> Plant:
        """Return itself, in the type that a sensor expects."""
        return cast("Plant", self)

    def put(self, x_m: float, y_m: float, theta_rad: float = 0.0) -> None:
        self.pose = Pose2(x_m, y_m, theta_rad)
