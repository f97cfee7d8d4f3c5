"""Kinds of faults of the device and the room: processor, sensors, wheels, battery, people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_device.faults.knobs import Carry, Knobs, Walker, either
from sim_device.faults.spec import Choice, FaultKind, Number, Value

if TYPE_CHECKING:
    from collections.abc import Mapping

_SIDE = Choice("side", "affected side", ("left", "right", "both"), "left")
_BOTH = Choice("side", "affected side", ("left", "right", "both"), "both")


def _clock_drift(knobs: Knobs, values: Mapping[str, Value]) -> None:
    knobs.drift_ppm += float(values["ppm"])


def _imu_frozen(knobs: Knobs, values: Mapping[str, Value]) -> None:
    del values
    knobs.imu_frozen = True


def _imu_biased(knobs: Knobs, values: Mapping[str, Value]) -> None:
    x, y, z = knobs.gyro_bias_deg_s
    knobs.gyro_bias_deg_s = (x, y, z + float(values["gyro"]))
    x, y, z = knobs.accel_bias_g
    knobs.accel_bias_g = (x + float(values["accel"]), y, z)


def _encoder_dropout(knobs: Knobs, values: Mapping[str, Value]) -> None:
    share = float(values["share"])
    for side in knobs.sides(str(values["side"])):
        name = f"encoder_dropout_{side}"
        setattr(knobs, name, either(getattr(knobs, name), share))


def _encoder_reversed(knobs: Knobs, values: Mapping[str, Value]) -> None:
    for side in knobs.sides(str(values["side"])):
        setattr(knobs, f"encoder_reversed_{side}", True)


def _encoder_swapped(knobs: Knobs, values: Mapping[str, Value]) -> None:
    del values
    knobs.encoders_swapped = True


def _i2c_stuck(knobs: Knobs, values: Mapping[str, Value]) -> None:
    del values
    knobs.i2c_stuck = True


def _imu_clock(knobs: Knobs, values: Mapping[str, Value]) -> None:
    knobs.imu_clock += 0.01 * float(values["percent"])


def _adc_frozen(knobs: Knobs, values: Mapping[str, Value]) -> None:
    del values
    knobs.adc_frozen = True


def _wheel_stuck(knobs: Knobs, values: Mapping[str, Value]) -> None:
    for side in knobs.sides(str(values["side"])):
        setattr(knobs, f"stuck_{side}", True)


def _wheel_slip(knobs: Knobs, values: Mapping[str, Value]) -> None:
    share = float(values["share"])
    for side in knobs.sides(str(values["side"])):
        name = f"slip_{side}"
        setattr(knobs, name, either(getattr(knobs, name), share))


def _ultrasonic_blind(knobs: Knobs, values: Mapping[str, Value]) -> None:
    del values
    knobs.ultrasonic_blind = True


def _ultrasonic_constant(knobs: Knobs, values: Mapping[str, Value]) -> None:
    knobs.ultrasonic_constant_m = float(values["m"])


def _bumper_stuck(knobs: Knobs, values: Mapping[str, Value]) -> None:
    for side in knobs.sides(str(values["side"])):
        setattr(knobs, f"bumper_stuck_{side}", True)


def _lifted(knobs: Knobs, values: Mapping[str, Value]) -> None:
    del values
    knobs.lifted = True


def _carried(knobs: Knobs, values: Mapping[str, Value]) -> None:
    knobs.lifted = True
    knobs.carry = Carry(float(values["dx"]), float(values["dy"]), float(values["turn"]))


def _obstacle(knobs: Knobs, values: Mapping[str, Value]) -> None:
    index = round(float(values["index"]))
    dx, dy = knobs.moved.get(index, (0.0, 0.0))
    knobs.moved[index] = (dx + float(values["dx"]), dy + float(values["dy"]))


def _person(knobs: Knobs, values: Mapping[str, Value]) -> None:
    knobs.walker = Walker(
        float(values["ahead"]),
        float(values["reach"]),
        float(values["speed"]),
        float(values["radius"]),
    )


_WHERE = (
    Number("dx", "along x of the room", "m", 0.5, -20.0, 20.0),
    Number("dy", "along y of the room", "m", 0.0, -20.0, 20.0),
    Number("turn", "turn, counter-clockwise", "°", 0.0, -180.0, 180.0),
)


BODY_KINDS = (
    FaultKind(
        "reset",
        "The processor restarts.",
        "reset@30:cause=watchdog",
        (
            Choice(
                "cause",
                "cause that the firmware reads",
                ("pin", "watchdog", "software", "power_on"),
                "pin",
            ),
        ),
        strike="reset",
    ),
    FaultKind(
        "hang",
        "The firmware hangs with its outputs unchanged, until the independent watchdog resets it "
        "after 0.1 s.",
        "hang@30",
        strike="hang",
    ),
    FaultKind(
        "crash",
        "The processor faults. It keeps program counter, link register, fault status and uptime "
        "across the reset, and reports them to the next host.",
        "crash@30",
        strike="crash",
    ),
    FaultKind(
        "hse-failed",
        "The crystal stops for good. The clock security system resets the processor, which runs on "
        "from its internal oscillator and stays off the CAN bus.",
        "hse-failed@0:ppm=5000",
        (Number("ppm", "drift of the internal oscillator", "ppm", 5000.0, -10_000.0, 10_000.0),),
        strike="hse_failed",
    ),
    FaultKind(
        "brown-out",
        "The 5 V rail drops below the processor's limit and returns after the time off.",
        "brown-out@30:off=0.5",
        (Number("off", "time without power", "s", 0.2, 0.0, 60.0),),
        strike="brown_out",
    ),
    FaultKind(
        "clock-drift",
        "The device's clock runs fast (positive) or slow.",
        "clock-drift@10:60:ppm=80",
        (Number("ppm", "drift", "ppm", 100.0, -10_000.0, 10_000.0),),
        _clock_drift,
    ),
    FaultKind(
        "clock-jump",
        "The device's clock jumps.",
        "clock-jump@20:ms=-50",
        (Number("ms", "forward, or back if negative", "ms", 100.0, -60_000.0, 60_000.0),),
        strike="clock_jump",
    ),
    FaultKind(
        "imu-frozen",
        "The inertial sensor's registers no longer change, as after a bus fault.",
        "imu-frozen@20:10",
        (),
        _imu_frozen,
    ),
    FaultKind(
        "i2c-stuck",
        "The bus to the inertial sensor is stuck: no new sample arrives.",
        "i2c-stuck@20:10",
        (),
        _i2c_stuck,
    ),
    FaultKind(
        "imu-clock",
        "The inertial sensor's own clock runs fast (positive) or slow: samples are skipped, or "
        "missing.",
        "imu-clock@0:percent=-1",
        (Number("percent", "deviation", "%", 1.0, -10.0, 10.0),),
        _imu_clock,
    ),
    FaultKind(
        "imu-biased",
        "The inertial sensor has a constant error.",
        "imu-biased@20:60:gyro=2",
        (
            Number("gyro", "added to the yaw rate", "°/s", 1.0, -250.0, 250.0),
            Number("accel", "added to the forward acceleration", "g", 0.0, -2.0, 2.0),
        ),
        _imu_biased,
    ),
    FaultKind(
        "encoder-dropout",
        "An encoder misses counts.",
        "encoder-dropout@20:10:side=right,share=0.5",
        (_SIDE, Number("share", "share of counts missed", "", 1.0, 0.0, 1.0)),
        _encoder_dropout,
    ),
    FaultKind(
        "encoder-reversed",
        "The channels of an encoder are exchanged: it counts backward.",
        "encoder-reversed@0:side=both",
        (_SIDE,),
        _encoder_reversed,
    ),
    FaultKind(
        "encoder-swapped",
        "The plugs of the encoders are exchanged: each wheel counts on the other side.",
        "encoder-swapped@0",
        (),
        _encoder_swapped,
    ),
    FaultKind(
        "adc-frozen",
        "The converter repeats its last readings of supply and motor currents.",
        "adc-frozen@20:10",
        (),
        _adc_frozen,
    ),
    FaultKind(
        "wheel-stuck",
        "A gearbox jams: the wheel does not turn, and the motor draws its stall current.",
        "wheel-stuck@20:3:side=left",
        (_SIDE,),
        _wheel_stuck,
    ),
    FaultKind(
        "wheel-slip",
        "A wheel turns, but moves the robot less than it should.",
        "wheel-slip@20:5:side=both,share=0.5",
        (_BOTH, Number("share", "share of the wheel's travel lost", "", 0.3, 0.0, 1.0)),
        _wheel_slip,
    ),
    FaultKind(
        "ultrasonic-blind",
        "The ultrasonic sensor receives no echo.",
        "ultrasonic-blind@20:10",
        (),
        _ultrasonic_blind,
    ),
    FaultKind(
        "ultrasonic-constant",
        "The ultrasonic sensor reports a constant distance.",
        "ultrasonic-constant@20:10:m=1.5",
        (Number("m", "reported distance", "m", 0.5, 0.02, 4.0),),
        _ultrasonic_constant,
    ),
    FaultKind(
        "bumper-stuck",
        "A bumper switch stays closed.",
        "bumper-stuck@20:10:side=left",
        (_SIDE,),
        _bumper_stuck,
    ),
    FaultKind(
        "battery-flat",
        "The battery is nearly empty from then on.",
        "battery-flat@60:charge=0.02",
        (Number("charge", "remaining share of its charge", "", 0.02, 0.0, 1.0),),
        strike="battery_flat",
    ),
    FaultKind(
        "lifted",
        "The robot is held up: its wheels turn freely, and the cliff sensor sees no floor.",
        "lifted@20:3",
        (),
        _lifted,
    ),
    FaultKind(
        "carried",
        "The robot is lifted, carried, and put down at another place after the duration, or on the "
        "way there if the place is not free. The gyro does not measure the turn.",
        "carried@20:3:dx=0.6,dy=0.2,turn=90",
        _WHERE,
        _carried,
        default_for_s=3.0,
    ),
    FaultKind(
        "displaced",
        "The robot is moved to another place without delay, as by a push that no sensor measures. "
        "At 0 s: the robot does not start at the start of the room. If the place is not free, the "
        "robot is put at the nearest free place on the line to its old place.",
        "displaced@0:dx=0.4,dy=0.1,turn=20",
        _WHERE,
        strike="displaced",
    ),
    FaultKind(
        "obstacle",
        "An obstacle of the room is moved. After the duration, if given, it is moved back.",
        "obstacle@30:index=0,dx=0.3,dy=-0.2",
        (
            Number("index", "index in the room file, from 0", "", 0.0, 0.0, 999.0),
            Number("dx", "along x", "m", 0.2, -20.0, 20.0),
            Number("dy", "along y", "m", 0.0, -20.0, 20.0),
        ),
        _obstacle,
    ),
    FaultKind(
        "person",
        "A leg walks back and forth across the robot's heading at the start of the fault. It does "
        "not walk into the robot. There is one person at a time; a second replaces the first.",
        "person@20:15:ahead=0.8,speed=0.5",
        (
            Number("ahead", "distance ahead of the robot's centre", "m", 0.8, 0.3, 10.0),
            Number("speed", "walking speed", "m/s", 0.8, 0.0, 5.0),
            Number("reach", "distance to either side", "m", 1.0, 0.0, 10.0),
            Number("radius", "radius of the leg", "m", 0.06, 0.01, 0.5),
        ),
        _person,
    ),
)
