"""The firmware's checks of its hardware: the conditions that set and clear each fault bit.

The checks use only sensor readings, as on the real robot: a fault bit means that readings
contradict each other. The checks have no access to the injected faults.

| bit | set | cleared |
|---|---|---|
| imu | at rest a rate above 20 °/s or a gravity off by 0.3 g for 0.3 s; or repeated registers | \
readings that agree |
| encoder | a driven wheel without counts for 1 s whose motor draws no stall current | a count |
| encoder_…_reversed, encoders_swapped | counts against the duty: ``signs`` | counts that agree |
| ultrasonic | two frontal contacts that it did not see; or an unchanged range over 0.4 m | \
a contact that it saw, a range that changes |
| infrared | an unchanged range while turning by 60° in place | a range that changes |
| motor_stall | a driven wheel that has not turned for 1 s and draws current | it turns or is idle |
| battery_low | below the parameter ``battery_low`` | above it |
| lifted | no floor ahead after a jolt up or down | the floor is back |
| bumper | a switch pressed for 10 s without a near obstacle or a stall | the switch opens |

``control`` sets ``setpoint_expired`` from the setpoint watchdog.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bridge.motion.estimation.odometry import encoder_delta
from protocol.imu import NOMINAL_GYRO_RAD_S
from protocol.messages.values import Fault
from sim_device.device.signs import BITS as SIGNS
from sim_device.device.signs import Signs

if TYPE_CHECKING:
    from sim_device.device.sampling import Around
    from sim_device.device.wheel_control import WheelControl
    from sim_device.sensors.imu import ImuCounts
    from sim_device.sensors.power_monitor import PowerReading

IMU = int(Fault.IMU)
ENCODER_LEFT, ENCODER_RIGHT = int(Fault.ENCODER_LEFT), int(Fault.ENCODER_RIGHT)
ULTRASONIC, INFRARED = int(Fault.ULTRASONIC), int(Fault.INFRARED)
MOTOR_STALL, BATTERY_LOW, LIFTED = (
    int(Fault.MOTOR_STALL),
    int(Fault.BATTERY_LOW),
    int(Fault.LIFTED),
)
BUMPER = int(Fault.BUMPER)
_ENCODERS = ENCODER_LEFT | ENCODER_RIGHT
_RANGERS = ULTRASONIC | INFRARED
_NO_DUTIES = (0.0, 0.0)

STALL_S = 1.0
"""Minimum time without motion of a driven wheel that counts as a stall, s. Without stall current it
is an encoder fault."""
STALL_STOP_S = 3.0
"""Maximum time at stall current, s. The planner ends an attempt after half of this time."""
STALL_A = 0.4
"""Minimum current of a stalled motor, A. A stalled motor draws 1 A or more. A running motor with a
broken encoder draws a fifth of this limit."""
JOLT_LSB = 2458
"""Minimum acceleration of a jolt, counts: 0.15 g at ±2 g. A lift by a person exceeds this limit
(0.25 g for 0.2 s)."""
JOLT_MEAN_TICKS = 8
"""Number of samples in the mean acceleration for jolt detection: 80 ms. The mean reduces a
vibration of 40 mg (noise level ``harsh``) to 14 mg."""
GRAVITY_TICKS = 128
"""Number of samples in the mean that is used as gravity: 1.3 s. With a constant instead of this
mean, a sensor bias of 50 mg would use a third of the jolt limit."""
_MEANS, _JOLT_SUM = GRAVITY_TICKS // JOLT_MEAN_TICKS, GRAVITY_TICKS * JOLT_LSB
JOLT_TICKS = 100
"""Maximum number of control periods from a jolt to a missing floor that counts as lifted: 1 s."""
REST_TICKS = 50
"""Number of control periods without counts after which the robot is at rest: 0.5 s."""
REST_RATE_LSB = 2620
"""Maximum rate reading at rest, counts: 20 °/s, the zero-rate output limit of the data sheet
(PS-MPU-6000A-00, section 6.1)."""
GRAVITY_LSB = 16384
"""Gravity in counts: 1 g at ±2 g."""
GRAVITY_OFF = 0.3
"""Maximum deviation of the acceleration from 1 g at rest, g."""
IMPLAUSIBLE_TICKS = 30
"""Number of consecutive readings that contradict rest, or the wheels, after which they are a fault:
0.3 s."""
REPEAT_TICKS = 50
"""Number of repeated readings of a chip with noise that are a fault: 0.5 s."""
QUIET_TICKS = 20
"""Minimum number of repeated readings that are compared with the wheels: 0.2 s."""
LEARN_TICKS = 200
"""Number of control periods after the boot in which the chip's noise is observed: 2 s."""
LIVELY_TICKS = 3
"""Maximum number of repeated readings of a chip with noise after its start. Nearly every chip has
noise. If such a chip repeats its readings for half a second, no new samples arrive. Repeats of a
chip without noise are a fault only if the yaw rate differs from the wheels' yaw rate."""
DISAGREE_RAD_S = 0.2
"""Maximum difference between the yaw rates of the gyro and of the wheels, rad/s."""
NEAR_M = 0.10
"""Maximum ultrasonic range to a wall that presses both bumper switches, m: 0.04 m and a margin."""
UNSEEN_CONTACTS = 2
"""Number of frontal contacts without a near ultrasonic range that are a fault."""
UNCHANGED_M = 0.02
"""Maximum change of an ultrasonic range that counts as unchanged, m."""
UNCHANGED_OVER_M = 0.4
"""Distance driven with an unchanged ultrasonic range that is a fault, m."""
INFRARED_UNCHANGED_M = 0.003
"""Maximum change of a side infrared range that counts as unchanged, m."""
TURN_RAD = math.radians(60.0)
"""Turn in place with an unchanged side infrared range that is a fault, rad."""
CREEP_M = 0.002
"""Maximum distance between two readings that counts as turning in place, m."""
EMPTY_READINGS = 5
"""Number of consecutive readings below ``battery_empty`` that stop the robot: 1 s at 5 readings per
second."""
PRESSED_READINGS = 200
"""Number of readings after which a pressed switch is a fault: 10 s at 20 readings per second."""
BESIDE_M = 0.08
"""Maximum side infrared range to an obstacle in contact on that side, m: 0.05 m and a margin."""


class Health:
    """Fault bits, updated in each period."""

    def __init__(self, *, has_ultrasonic: bool = True) -> None:
        """Start without readings and without a fault."""
        self._has_ultrasonic = has_ultrasonic
        self.bits = 0
        """Fault bits (``protocol.messages.values.Fault``)."""
        self.battery_empty = False
        self._currents_a = (0.0, 0.0)
        self._empty = 0
        self._imu: ImuCounts | None = None
        self._tick = self._repeats = self._longest = self._disagrees = self._implausible = 0
        self._moved_tick, self._jolt_tick = 0, -JOLT_TICKS
        """Control periods of the last wheel motion and of the last jolt."""
        self._up = [GRAVITY_LSB] * JOLT_MEAN_TICKS
        """Last acceleration readings along z. The next attribute is their sum."""
        self._up_sum = GRAVITY_LSB * JOLT_MEAN_TICKS
        self._gravity_sum, self._gravity_next = GRAVITY_LSB * GRAVITY_TICKS, 0
        """Sums over the last complete and over the present run of ``GRAVITY_TICKS`` readings."""
        self._signs = Signs()
        self._pressed = [0, 0]
        self._counts = self._range_counts = (0, 0)
        self._unseen_contacts = 0
        self._touched = False
        self._sonar_m: float | None = None
        self._unseen_m = 0.0
        self._side_m: list[float | None] = [None, None]
        self._side_rad = [0.0, 0.0]

    @property
    def stopping(self) -> str | None:
        """Description of the fault that prevents driving; None without such a fault."""
        bits = self.bits
        if bits & LIFTED:
            return "lifted"
        if bits & (_ENCODERS | SIGNS):
            return "encoder"
        return "battery empty" if self.battery_empty else None

    def _set(self, fault: int, *, present: bool) -> None:
        self.bits = self.bits | fault if present else self.bits & ~fault

    # ---- each period ----------------------------------------------------------------------

    def tick(
        self,
        imu: ImuCounts,
        counts: tuple[int, int],
        wheels: WheelControl,
        duties: tuple[float, float],
    ) -> None:
        """Run the checks of one control period (10 ms), after the wheel control."""
        self._tick = tick = self._tick + 1
        if counts != self._counts:
            self._moved_tick = tick
            if self.bits & _ENCODERS:
                self._counted(counts)
            self._counts = counts
        self._check_jolt(imu[2], tick)
        signs = self._signs
        if duties != _NO_DUTIES or signs.driven:
            signs.tick(duties, (wheels.left.speed_m_s, wheels.right.speed_m_s))
            self.bits = self.bits & ~SIGNS | signs.bits
        if imu == self._imu:
            self._repeats += 1
            self._judge_imu(imu, wheels)
        else:
            self._repeats = 0
            self._imu = imu
            if tick - self._moved_tick >= REST_TICKS or self.bits & IMU:
                self._judge_imu(imu, wheels)
        if wheels.stalling or self.bits & MOTOR_STALL:
            self._judge_stall(wheels)

    def _check_jolt(self, up_lsb: int, tick: int) -> None:
        """Detect jolts in the acceleration along z: the short mean then differs from gravity."""
        place = tick % JOLT_MEAN_TICKS
        self._up_sum += up_lsb - self._up[place]
        self._up[place] = up_lsb
        self._gravity_next += up_lsb
        if tick % GRAVITY_TICKS == 0:
            self._gravity_sum, self._gravity_next = self._gravity_next, 0
        jolt = self._up_sum * _MEANS - self._gravity_sum
        if jolt > _JOLT_SUM or jolt < -_JOLT_SUM:
            self._jolt_tick = tick

    def _counted(self, counts: tuple[int, int]) -> None:
        if counts[0] != self._counts[0]:
            self.bits &= ~ENCODER_LEFT
        if counts[1] != self._counts[1]:
            self.bits &= ~ENCODER_RIGHT

    def _judge_imu(self, imu: ImuCounts, wheels: WheelControl) -> None:
        self._implausible = self._implausible + 1 if self._implausible_at_rest(imu) else 0
        repeats = self._repeats
        if self._tick <= LEARN_TICKS:
            self._longest = max(self._longest, repeats)
        apart = abs(wheels.yaw_rate_rad_s - imu[6] * NOMINAL_GYRO_RAD_S) > DISAGREE_RAD_S
        self._disagrees = self._disagrees + 1 if repeats >= QUIET_TICKS and apart else 0
        lively = self._tick > LEARN_TICKS and self._longest <= LIVELY_TICKS
        dead = (lively and repeats >= REPEAT_TICKS) or self._disagrees >= IMPLAUSIBLE_TICKS
        if dead or self._implausible >= IMPLAUSIBLE_TICKS:
            self.bits |= IMU
        elif not repeats and not self._implausible:
            self.bits &= ~IMU

    def _implausible_at_rest(self, imu: ImuCounts) -> bool:
        """Return whether a robot at rest has readings that are impossible at rest."""
        if self._tick - self._moved_tick < REST_TICKS or self.bits & LIFTED:
            return False
        gravity = math.sqrt(imu[0] * imu[0] + imu[1] * imu[1] + imu[2] * imu[2]) / GRAVITY_LSB
        return (
            max(abs(rate) for rate in imu[4:]) > REST_RATE_LSB or abs(gravity - 1.0) > GRAVITY_OFF
        )

    def _judge_stall(self, wheels: WheelControl) -> None:
        stall = False
        for wheel, current_a, encoder in (
            (wheels.left, self._currents_a[0], ENCODER_LEFT),
            (wheels.right, self._currents_a[1], ENCODER_RIGHT),
        ):
            if wheel.stalled_s >= STALL_S:
                if abs(current_a) >= STALL_A:
                    stall = True
                else:
                    self.bits |= encoder
        self._set(MOTOR_STALL, present=stall)

    @staticmethod
    def stalled_too_long(wheels: WheelControl) -> bool:
        """Return whether a motor has drawn its stall current for too long."""
        return wheels.stalled_s >= STALL_STOP_S

    # ---- each reading ---------------------------------------------------------------------

    def on_power(self, reading: PowerReading, low_v: float, empty_v: float) -> None:
        """Process a reading of the supply (5 Hz)."""
        battery_v = reading.battery_v
        self._currents_a = reading.left_a, reading.right_a
        self._set(BATTERY_LOW, present=battery_v < low_v)
        self._empty = self._empty + 1 if battery_v < empty_v else 0
        self.battery_empty = self._empty >= EMPTY_READINGS

    def on_around(self, around: Around, wheel_base_m: float, metres_per_count: float) -> None:
        """Process rangers and contacts, and the wheels' travel since the last reading."""
        sonar_m, left_m, right_m, bumper_left, bumper_right, cliff, _ = around
        (left, right), (left_0, right_0) = self._counts, self._range_counts
        self._range_counts = self._counts
        left, right = encoder_delta(left_0, left), encoder_delta(right_0, right)
        ahead_m = 0.5 * (left + right) * metres_per_count
        turned_rad = (right - left) * metres_per_count / wheel_base_m
        bits = self.bits & ~(_RANGERS | BUMPER)
        if self._switch_stays(around):
            bits |= BUMPER
        if not cliff:
            bits &= ~LIFTED
        elif self._tick - self._jolt_tick < JOLT_TICKS:
            bits |= LIFTED
        if self._has_ultrasonic and self._is_ultrasonic_wrong(
            sonar_m, bumper_left and bumper_right, ahead_m, turned_rad
        ):
            bits |= ULTRASONIC
        creeps = -CREEP_M <= ahead_m <= CREEP_M
        for side, range_m in enumerate((left_m, right_m)):
            before_m = self._side_m[side]
            if range_m != before_m and not (
                creeps
                and range_m is not None
                and before_m is not None
                and abs(range_m - before_m) <= INFRARED_UNCHANGED_M
            ):
                self._side_m[side], self._side_rad[side] = range_m, 0.0
            elif creeps and range_m is not None:
                self._side_rad[side] += abs(turned_rad)
            if self._side_rad[side] >= TURN_RAD:
                bits |= INFRARED
        self.bits = bits

    def _switch_stays(self, around: Around) -> bool:
        """Return whether a switch is pressed for a long time without other evidence of contact."""
        sonar_m, left_m, right_m, bumper_left, bumper_right, _, _ = around
        ahead = sonar_m is not None and sonar_m <= NEAR_M
        stalls = bool(self.bits & MOTOR_STALL)
        pressed = self._pressed
        for side, (down, range_m) in enumerate(((bumper_left, left_m), (bumper_right, right_m))):
            beside = range_m is not None and range_m <= BESIDE_M
            if not down or ahead or beside or stalls:
                pressed[side] = 0
            elif pressed[side] < PRESSED_READINGS:
                pressed[side] += 1
        return max(pressed) >= PRESSED_READINGS

    def _is_ultrasonic_wrong(
        self,
        sonar_m: float | None,
        touched: bool,  # noqa: FBT001 - a part of a reading
        ahead_m: float,
        turned_rad: float,
    ) -> bool:
        """Return whether the ultrasonic sensor contradicts the other sensors for a long time."""
        if touched and not self._touched:
            saw = sonar_m is not None and sonar_m <= NEAR_M
            self._unseen_contacts = 0 if saw else self._unseen_contacts + 1
        self._touched = touched
        before_m = self._sonar_m
        if sonar_m is None or before_m is None or abs(sonar_m - before_m) > UNCHANGED_M:
            if sonar_m is not None and before_m is not None:
                self._unseen_contacts = 0
            self._sonar_m, self._unseen_m = sonar_m, 0.0
        elif sonar_m > NEAR_M and not touched and abs(turned_rad) <= 0.5 * abs(ahead_m):
            self._unseen_m += max(0.0, ahead_m)
        return self._unseen_contacts >= UNSEEN_CONTACTS or self._unseen_m >= UNCHANGED_OVER_M
