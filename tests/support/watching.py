"""Handmade control steps for tests of the supervisor; by default the robot is at rest."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.supervise.inputs import RuleInputs
from bridge.supervise.measured import Measured
from protocol.messages.device import Encoders, Imu, PlannerState, Power, Range, Status

if TYPE_CHECKING:
    from bridge.supervise.rules.conditions import Condition

MODEL = RobotModel()
STEP_S = 0.02
G_LSB = 16384
PER_COUNT_M = 3.141592653589793 * 0.065 / 1560
"""Travel per encoder count of the default robot, m, by eq. 3 of the paper."""


def imu(x: int = 0, y: int = 0, z: int = G_LSB, *, yaw: int = 0, mark: int = 0) -> Imu:
    """Return an IMU sample; ``mark`` makes it unique through a register that no rule reads."""
    return Imu(x, y, z, mark, 0, 0, yaw)


def reading(front_m: float | None = None, contacts: int = 0) -> Range:
    """Return a reading of the rangers in which only the front ranger has a range."""
    front = 0xFFFF if front_m is None else round(front_m * 1000)
    return Range(front, 0xFF, 0xFF, contacts, 0)


def power(volts: float = 16.0, left_a: float = 0.1, right_a: float = 0.1) -> Power:
    """Return a reading of the supply."""
    return Power(round(volts * 1000), 200, round(left_a / 0.02), round(right_a / 0.02))


def status(faults: int = 0) -> Status:
    """Return a status of the device."""
    return Status(3, 0, faults, 0, 5)


def planner(  # noqa: PLR0913 - the paper's variables
    phase: int = 1,
    *,
    turns: int = 0,
    distance: int = 0,
    previous: int = 0,
    length: int = 0,
    case: int = 0,
) -> PlannerState:
    """Return a state of the device's planner, in wire units."""
    return PlannerState(phase, turns, 0, 0, distance, previous, length, case)


class Walk:
    """Consecutive control steps of 20 ms, with a given wheel travel."""

    def __init__(self, *conditions: Condition) -> None:
        self.conditions = conditions
        self.measured = Measured(MODEL)
        self.time_s = 100.0
        self.left_m = self.right_m = 0.0
        self.held = False
        """True if the first condition was true at the last step."""
        self.changes: list[tuple[float, bool]] = []
        """Times at which the first condition became true or false, s since the first step."""

    def step(
        self, count: int = 1, *, left_m: float = 0.0, right_m: float = 0.0, **values: object
    ) -> bool:
        """Run a number of control steps, each with this wheel travel."""
        for _ in range(count):
            self.left_m += left_m
            self.right_m += right_m
            self.time_s += STEP_S
            self.look(**values)
        return self.held

    def look(self, **values: object) -> bool:
        """Run one control step without wheel travel."""
        counts = Encoders(
            round(self.left_m / PER_COUNT_M) & 0xFFFF, round(self.right_m / PER_COUNT_M) & 0xFFFF
        )
        defaults: dict[str, Any] = {
            "pose": Pose2(0.0, 0.0, 0.0),
            "v_m_s": 0.0,
            "yaw_rate_rad_s": 0.0,
            "last_frame_s": self.time_s,
            "encoders": counts,
        }
        inputs = RuleInputs(time_s=self.time_s, **{**defaults, **values})
        self.measured.step(inputs)
        for index, condition in enumerate(self.conditions):
            held = condition.holds(inputs, self.measured)
            if index == 0:
                if held is not self.held:
                    self.changes.append((round(self.time_s - 100.0, 3), held))
                self.held = held
        return self.held
