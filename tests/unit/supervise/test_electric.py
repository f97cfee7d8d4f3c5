"""The rules for stall, battery, silence, sensors and reset, each at its limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.motion.geometry import Pose2
from bridge.supervise.inputs import RuleInputs
from bridge.supervise.measured import Measured
from bridge.supervise.rules.electric import Battery, Reset, Sensor, Silence, Stall
from bridge.supervise.settings import BatteryRule, SilenceRule, StallRule
from protocol.messages.device import Encoders, Imu, PlannerState, Power, Range, Status
from protocol.messages.values import Fault
from support.watching import MODEL, STEP_S, Walk, imu, power, status

if TYPE_CHECKING:
    from bridge.supervise.rules.conditions import Condition

# ---- stall -------------------------------------------------------------------------------


def stall() -> Stall:
    return Stall(StallRule(current_a=0.5))


def test_a_wheel_that_stands_under_current_stalls() -> None:
    walk = Walk(rule := stall())
    first, second = power(), power(left_a=0.5, right_a=0.1)
    walk.step(10, right_m=0.002, power=first)
    assert walk.step(1, power=second)
    assert rule.evidence()[1] == {"by": "host", "side": "left", "current_a": 0.5}
    assert walk.step(9, power=second), "the finding lasts until the next reading"
    assert not walk.step(1, power=power(left_a=0.48))


@pytest.mark.parametrize(("path_m", "stands"), [(0.00385, True), (0.0043, False)])
def test_a_wheel_stands_below_2_cm_s(path_m: float, *, stands: bool) -> None:
    """The limit is 4 mm between two readings at 5 Hz. It applies to both wheels and directions."""
    for side, sign in (("left_m", 1), ("left_m", -1), ("right_m", 1), ("right_m", -1)):
        walk = Walk(rule := stall())
        first = power()
        walk.step(1, power=first)
        walk.step(9, power=first, **{side: sign * path_m / 9})
        assert walk.step(1, power=power(left_a=1.0, right_a=1.0))
        name = "left" if side == "left_m" else "right"
        reported = rule.evidence()[1]["side"]
        assert isinstance(reported, str)
        assert (name in reported) is stands


def test_ways_are_counted_from_one_reading_to_the_next() -> None:
    walk = Walk(stall())
    first, second = power(), power(left_a=1.0, right_a=1.0)
    walk.step(1, power=first)
    walk.step(10, left_m=0.002, right_m=0.002, power=first)
    assert not walk.step(1, power=second)
    walk.step(9, power=second)
    assert walk.step(1, power=power(left_a=1.0)), "the wheel has not moved since the second reading"


def test_the_first_reading_has_no_effect() -> None:
    assert not Walk(stall()).step(3, power=power(left_a=2.0, right_a=2.0))
    assert not Walk(stall()).step(3, power=None)


def test_the_devices_own_word_is_enough() -> None:
    walk = Walk(rule := stall())
    assert not walk.step(1, status=status(int(Fault.INFRARED)))
    assert walk.step(1, status=status(int(Fault.MOTOR_STALL | Fault.IMU)))
    assert rule.evidence()[1] == {"by": "device"}
    assert not walk.step(1, status=status())
    rule.restart()
    assert not walk.step(1, status=None)


# ---- battery -----------------------------------------------------------------------------


def battery() -> Battery:
    return Battery(BatteryRule(low_v=12.8, empty_v=12.0))


def drain(walk: Walk, volts: float, seconds: float) -> bool:
    """Send readings of this voltage at 5 Hz."""
    for _ in range(round(5 * seconds)):
        walk.step(10, power=power(volts))
    return walk.held


@pytest.mark.parametrize(
    ("volts", "low", "empty"),
    [(12.85, False, False), (12.75, True, False), (12.05, True, False), (11.93, True, True)],
)
def test_the_battery_at_its_limits(volts: float, *, low: bool, empty: bool) -> None:
    walk = Walk(rule := battery())
    assert drain(walk, volts, 4.0) is low
    assert rule.grave is empty
    if low:
        text, data = rule.evidence()
        assert text == f"the battery is {'empty' if empty else 'low'}: {volts:.1f} V"
        assert data == {"by": "host", "battery_v": volts, "limit_v": 12.0 if empty else 12.8}


def test_a_dip_is_smoothed_over_a_second() -> None:
    """One reading of 9.876 V after 16 V moves the mean by a fifth of the difference."""
    walk = Walk(rule := battery())
    drain(walk, 16.0, 2.0)
    dip = power(9.876)
    walk.step(10, power=dip)
    assert not walk.held
    assert rule.evidence() == (
        "the device reports a low battery",
        {"by": "device", "battery_v": 14.78},
    )
    assert drain(walk, 10.0, 1.0)


def test_the_device_reports_that_it_is_low() -> None:
    walk = Walk(rule := battery())
    assert walk.step(1, status=status(int(Fault.BATTERY_LOW)))
    assert rule.evidence() == ("the device reports a low battery", {"by": "device"})
    assert not rule.grave
    assert not walk.step(1, status=status(int(Fault.IMU)))
    drain(walk, 11.0, 1.0)
    rule.restart()
    assert not rule.grave
    assert not walk.step(1), "a restart discards the voltage"
    assert drain(walk, 11.0, 0.2), "the first reading after a restart is not smoothed"


# ---- silence -----------------------------------------------------------------------------


def silence() -> Silence:
    return Silence(SilenceRule(silent_s=0.4, stream_s=1.0))


def test_nothing_of_the_device() -> None:
    walk = Walk(rule := silence())
    assert not walk.look(last_frame_s=walk.time_s - 0.39)
    assert walk.look(last_frame_s=walk.time_s - 0.42)
    assert rule.evidence()[1] == {"stream": "", "for_s": 0.42}
    assert not walk.look(last_frame_s=walk.time_s)


@pytest.mark.parametrize("kind", [Encoders, Imu, Range, Status, Power, PlannerState])
def test_a_stream_that_ends(kind: type[Encoders | Imu | Range | Status | Power]) -> None:
    walk = Walk(rule := silence())
    others = dict.fromkeys((Encoders, Imu, Range, Status, Power, PlannerState), walk.time_s)
    assert not walk.look(arrived_s={**others, kind: walk.time_s - 0.98})
    assert walk.look(arrived_s={**others, kind: walk.time_s - 1.02})
    assert rule.evidence()[1] == {"stream": kind.__name__.lower(), "for_s": 1.02}
    del others[kind]
    assert not walk.look(arrived_s=others), "a stream that never started is not silent"
    rule.restart()
    assert not walk.look(arrived_s=others)


# ---- sensor and reset --------------------------------------------------------------------


@pytest.mark.parametrize(
    "fault",
    [Fault.IMU, Fault.ENCODER_LEFT, Fault.ENCODER_RIGHT, Fault.ULTRASONIC, Fault.INFRARED],
)
def test_sensor_reports_of_the_device(fault: Fault) -> None:
    walk = Walk(rule := Sensor())
    assert walk.step(1, status=status(int(fault | Fault.LIFTED)))
    assert rule.evidence()[1] == {"sensor": (fault.name or "").lower()}
    assert not walk.step(1, status=status(int(Fault.LIFTED | Fault.BATTERY_LOW)))
    assert not walk.step(1, status=None)


def test_registers_that_do_not_change_while_the_wheels_turn() -> None:
    """The robot turns in place for a second at 0.25 rad/s."""
    walk = Walk(rule := Sensor())
    path_m = 0.5 * 0.23 * 0.25 * STEP_S
    walk.step(1, imu=imu(mark=1))
    assert not walk.step(49, left_m=-path_m, right_m=path_m, imu=imu(mark=1))
    assert walk.step(2, left_m=-path_m, right_m=path_m, imu=imu(mark=1))
    assert rule.evidence()[1] == {"sensor": "imu", "frozen_s": pytest.approx(1.0, abs=0.03)}
    assert not walk.step(1, left_m=-path_m, right_m=path_m, imu=imu(mark=2))
    assert not walk.step(49, left_m=path_m, right_m=-path_m, imu=imu(mark=2))
    assert walk.step(2, left_m=path_m, right_m=-path_m, imu=imu(mark=2))
    rule.restart()
    assert not walk.step(1, imu=imu(mark=2))


def test_constant_registers_on_a_straight_path_are_no_fault() -> None:
    walk = Walk(Sensor())
    slow_m = 0.5 * 0.23 * 0.15 * STEP_S
    assert not walk.step(200, left_m=0.004, right_m=0.004, imu=imu())
    assert not walk.step(200, left_m=-slow_m, right_m=slow_m, imu=imu())
    assert not walk.step(200, left_m=-0.01, right_m=0.01, imu=None)


def test_another_boot_is_a_reset() -> None:
    walk = Walk(rule := Reset())
    assert not walk.step(2, boot_id=7)
    assert walk.step(1, boot_id=8)
    assert rule.evidence()[1] == {"boot_id": "8", "was": "7"}
    rule.restart()
    assert walk.step(1, boot_id=8), "the supervised boot was 7"
    assert not walk.step(1, boot_id=7)


# ---- exactly at the limit ------------------------------------------------------------------


@pytest.mark.parametrize("rule", [stall(), battery(), silence(), Sensor(), Reset()])
def test_no_single_finding_requires_the_second_reaction(rule: Condition) -> None:
    assert rule.grave is False
    assert Walk(rule).step(2, power=power(), status=status(), imu=imu(), boot_id=3) is False
    assert rule.grave is False


def test_a_wheel_that_makes_4_mm_does_not_stand() -> None:
    """The test sets the whole distance in one step, so that it is exact."""
    for path_m, stands in ((0.004, False), (0.00399, True)):
        rule, measured = stall(), Measured(MODEL)
        inputs = RuleInputs(0.0, Pose2(0.0, 0.0, 0.0), 0.0, 0.0, power=power())
        rule.holds(inputs, measured)
        measured.left_m = measured.right_m = path_m
        assert rule.holds(inputs._replace(power=power(left_a=0.9, right_a=0.1)), measured) is stands


def test_of_two_stalled_wheels_the_greater_current_is_reported() -> None:
    walk = Walk(rule := stall())
    walk.step(1, power=power())
    assert walk.step(1, power=power(left_a=0.58, right_a=0.86))
    text, data = rule.evidence()
    assert text == "the left and right wheel stands still while its motor draws 0.9 A"
    assert data == {"by": "host", "side": "left and right", "current_a": 0.86}
    assert walk.step(1, power=None), "there is no newer reading"


def test_at_its_limits_the_battery_is_neither_low_nor_empty() -> None:
    walk = Walk(rule := battery())
    assert walk.step(1, power=power(12.8)) is False
    assert walk.step(1, power=None) is False
    assert rule.evidence()[1] == {"by": "device", "battery_v": 12.8}
    walk = Walk(rule := battery())
    assert walk.step(1, power=power(12.0))
    assert rule.grave is False
    walk = Walk(rule := battery())
    assert walk.step(1, power=power(11.876))
    assert rule.grave is True
    assert rule.evidence()[1]["battery_v"] == 11.88


def test_a_reading_after_a_long_time_is_not_smoothed() -> None:
    walk = Walk(rule := battery())
    walk.step(1, power=power(16.0))
    walk.time_s += 3.0
    assert walk.step(1, power=power(12.5))
    assert rule.evidence()[1]["battery_v"] == 12.5


def test_a_device_is_silent_only_after_its_time() -> None:
    walk = Walk(rule := Silence(SilenceRule(silent_s=0.5, stream_s=1.0)))
    walk.time_s = 8.0
    assert walk.look(last_frame_s=7.5) is False
    assert walk.look(last_frame_s=7.375) is True
    assert rule.evidence() == ("no data from the device for 0.6 s", {"stream": "", "for_s": 0.62})
    assert walk.look(last_frame_s=8.0, arrived_s={Imu: 7.0}) is False
    assert walk.look(last_frame_s=8.0, arrived_s={Imu: 6.875}) is True
    text = "no data from the stream imu for 1.1 s"
    assert rule.evidence() == (text, {"stream": "imu", "for_s": 1.12})


def test_registers_stand_still_for_a_second_of_turning() -> None:
    """Steps of 0.125 s add up exactly. A turn of 0.025 rad in one step is 0.2 rad/s, the limit."""
    sample, measured = imu(), Measured(MODEL)
    inputs = RuleInputs(0.0, Pose2(0.0, 0.0, 0.0), 0.0, 0.0, imu=sample)
    measured.step_s = 0.125
    for turn_rad, found in ((0.025, False), (0.0251, True), (-0.0251, True)):
        rule = Sensor()
        measured.wheel_turn_rad = turn_rad
        assert [rule.holds(inputs, measured) for _ in range(8)] == [False] * 8
        assert rule.holds(inputs, measured) is found
        rule.holds(inputs, measured)
        if found:
            text = "the IMU's values are constant while the robot turns"
            assert rule.evidence() == (text, {"sensor": "imu", "frozen_s": 1.12})
