"""Detection of wheels that spin while the robot stands, from the gyro and the range ahead."""

from __future__ import annotations

from typing import Any

import pytest

from bridge.motion.geometry import Pose2
from bridge.run.spinning import SpinCheck
from bridge.supervise.inputs import RuleInputs
from protocol.messages.device import Encoders
from protocol.messages.values import Contact
from support.watching import MODEL, PER_COUNT_M, reading

STEP_S = 0.06


class Drive:
    """A drive in steps of 60 ms, with given wheel speeds and yaw rate."""

    def __init__(self) -> None:
        self.check = SpinCheck(MODEL)
        self.time_s, self.left_m, self.right_m = 50.0, 0.0, 0.0

    def run(  # noqa: PLR0913 - one parameter per part of the motion
        self,
        for_s: float,
        left_m_s: float,
        right_m_s: float,
        *,
        yaw_rate_rad_s: float = 0.0,
        front_m: float | None = None,
        closing: float = 1.0,
        contacts: int = 0,
        stands: bool = False,
    ) -> tuple[float, str] | None:
        """Return time (s) and text of the check's first report; None without a report."""
        begun_s = self.time_s
        while self.time_s < begun_s + for_s:
            self.time_s += STEP_S
            self.left_m += left_m_s * STEP_S
            self.right_m += right_m_s * STEP_S
            gone_m = 0.5 * (left_m_s + right_m_s) * (self.time_s - begun_s)
            values: dict[str, Any] = {
                "encoders": Encoders(
                    round(self.left_m / PER_COUNT_M) & 0xFFFF,
                    round(self.right_m / PER_COUNT_M) & 0xFFFF,
                ),
                "range": reading(None if front_m is None else front_m - closing * gone_m, contacts),
            }
            pose, v_m_s = Pose2(0.0, 0.0, 0.0), 0.5 * (left_m_s + right_m_s)
            inputs = RuleInputs(self.time_s, pose, v_m_s, yaw_rate_rad_s, **values)
            text = self.check.step(inputs, stands=stands)
            if text is not None:
                return self.time_s - begun_s, text
        return None


def test_a_turn_that_the_gyro_confirms_is_none() -> None:
    assert Drive().run(10.0, -0.2, 0.2, yaw_rate_rad_s=0.4 / MODEL.wheel_base_m) is None


def test_wheels_that_turn_a_robot_which_stays() -> None:
    found = Drive().run(10.0, -0.2, 0.2)
    assert found is not None
    assert found[0] < 1.5
    assert "wheels and gyro differ" in found[1]


def test_one_wheel_that_spins_lets_the_robot_turn() -> None:
    found = Drive().run(10.0, 0.2, 0.2, yaw_rate_rad_s=0.2 / MODEL.wheel_base_m)
    assert found is not None
    assert found[0] < 3.0


def test_a_slip_of_a_tenth_in_a_turn_is_none() -> None:
    rate = 0.9 * 0.4 / MODEL.wheel_base_m
    assert Drive().run(10.0, -0.2, 0.2, yaw_rate_rad_s=rate) is None


@pytest.mark.parametrize(
    ("closing", "spins"), [(1.0, False), (0.3, False), (0.1, True), (0.0, True)]
)
def test_a_range_that_stays_on_a_straight_run(closing: float, *, spins: bool) -> None:
    found = Drive().run(4.0, 0.2, 0.2, front_m=1.5, closing=closing)
    assert (found is not None) is spins
    if found is not None:
        assert found[0] < 3.5
        assert "range ahead stayed" in found[1]


def test_a_robot_that_pushes_something_may_slip() -> None:
    contacts = int(Contact.BUMPER_LEFT)
    assert Drive().run(8.0, 0.1, 0.1, front_m=0.05, closing=0.0, contacts=contacts) is None


def test_nothing_is_concluded_across_a_gap() -> None:
    drive = Drive()
    assert drive.run(0.6, -0.2, 0.2) is None
    drive.time_s += 1.0
    assert drive.run(0.6, -0.2, 0.2) is None
    drive.check.restart()
    assert drive.run(0.6, -0.2, 0.2) is None


def test_a_standstill_by_the_accelerometer_while_the_wheels_turn() -> None:
    found = Drive().run(4.0, 0.2, 0.2, stands=True)
    assert found is not None
    assert 1.0 < found[0] < 1.3
    assert "the robot stands" in found[1]
    assert Drive().run(4.0, 0.05, 0.05, stands=True) is None, "too slow for a reliable result"
    contacts = int(Contact.BUMPER_RIGHT)
    assert Drive().run(4.0, 0.2, 0.2, stands=True, contacts=contacts) is None, (
        "the contact explains it"
    )
