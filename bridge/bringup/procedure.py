"""Bring-up, wheels off the floor: one look after the other, each with its finding.

Nothing turns before the person beside the robot has said yes. What a program cannot see - which
wheel turned, and which way - it asks.
"""

from __future__ import annotations

import math
from collections import deque
from statistics import fmean
from typing import TYPE_CHECKING, NamedTuple

from bridge.bringup.gyro import MIN_SAMPLES, biases
from bridge.bringup.wheel_step import WheelStep, judge_step, wheel_steps
from bridge.bringup.wiring import (
    LEFT,
    RIGHT,
    Finding,
    ImuSample,
    Kick,
    good,
    judge_axis,
    judge_kicks,
    judge_power,
    judge_rest,
    left_out,
    strongest,
    wrong,
)
from bridge.errors import BridgeError, CommandRejectedError, StoppedForSafetyError
from bridge.motion.kinematics import encoder_delta
from protocol.messages.device import Encoders, Imu, Power, Range, Status
from protocol.messages.host import SetStreamRate
from protocol.messages.values import Contact, Fault, Mode, flag_labels

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

    from bridge.bringup.desk import Desk
    from bridge.bringup.person import Person
    from bridge.motion.robot_model import RobotModel

STEPS = ("supply", "rest", "motors", "axes", "sensors", "control")
"""In the order in which each needs the one before."""
REST_S = 2.0
REST_TRIES = 5
"""Rests in which a person may touch the robot, before its axes are left out."""
KICK_DUTY, KICK_S = 0.3, 0.8
"""About 6 cm at the rim: seen by eye, and hundreds of counts."""
HAND_S = 20.0
"""For a person to do what was asked."""
RELEASE_S = 4.0
TURN_RAD, TILT_M_S2 = math.radians(45.0), 2.5
"""A quarter turn and 15°, less what hands leave out."""
STEP_M_S, STEP_S = 0.15, 1.5
_TURNED = {
    "lf": "the LEFT wheel, forwards",
    "lb": "the LEFT wheel, backwards",
    "rf": "the RIGHT wheel, forwards",
    "rb": "the RIGHT wheel, backwards",
    "n": "neither",
}


class BringUp:
    """The procedure; ``findings`` and ``steps`` hold what it saw."""

    def __init__(
        self, desk: Desk, person: Person, model: RobotModel, *, clear_stop: bool = False
    ) -> None:
        """Do nothing yet."""
        self._desk, self._person, self._model = desk, person, model
        self._clear_stop = clear_stop
        self._asked_off_floor = False
        self.findings: list[Finding] = []
        self.steps: tuple[WheelStep, ...] = ()

    def run(self, wanted: tuple[str, ...] = STEPS) -> list[Finding]:
        """Take the steps wanted, in their order.

        Raises:
            DeviceLostError: the device fell silent.
            StoppedForSafetyError: it stopped by itself, or holds a stop.
            CommandRejectedError: it refused.
            InterruptedByPersonError: the person has enough.

        """
        looks: dict[str, Callable[[], Iterator[Finding]]] = {
            "supply": self._supply,
            "rest": self._rest,
            "motors": self._motors,
            "axes": self._axes,
            "sensors": self._sensors,
            "control": self._control,
        }
        for name in STEPS:
            if name in wanted:
                for finding in looks[name]():
                    self._note(finding)
        return self.findings

    @property
    def well(self) -> bool:
        """Whether nothing was found wrong."""
        return all(f.ok is not False for f in self.findings)

    def _note(self, finding: Finding) -> None:
        self.findings.append(finding)
        self._person.report(finding)

    # ---- what needs no hands --------------------------------------------------------------

    def _supply(self) -> Iterator[Finding]:
        power = self._desk.await_newest(Power)
        currents = power.motor_left_a, power.motor_right_a
        yield from judge_power(power.battery_v, power.logic_v, currents, self._model.battery_v)

    def _rest(self) -> Iterator[Finding]:
        self._person.show("Let the robot stand level and still.")
        counts = self._desk.watch(Encoders)
        readings = self._desk.collect(Imu, REST_S)
        self._desk.unwatch(counts)
        yield from judge_rest([_sample(message) for _, message in readings])
        moved = {(m.left, m.right) for _, m in counts if isinstance(m, Encoders)}
        if len(moved) > 1:
            advice = "does a wheel turn? else look at the encoders' supply and shielding"
            yield wrong("encoders at rest", "they count", advice)
        elif moved:
            yield good("encoders at rest", "they stand")
        faults = flag_labels(Fault, self._desk.await_newest(Status).faults & ~int(Fault.LIFTED))
        if faults:
            yield wrong("device", f"tells of {', '.join(faults)}", "see its log lines above")

    # ---- motors and encoders --------------------------------------------------------------

    def _off_floor(self, what: str) -> bool:
        text = f"{what} Are BOTH WHEELS OFF THE FLOOR and free to turn?"
        self._asked_off_floor = self._asked_off_floor or self._person.confirm(text)
        return self._asked_off_floor

    def _motors(self) -> Iterator[Finding]:
        if not self._off_floor("Each wheel will now be turned for a moment."):
            yield left_out("motors", "the wheels are not free")
            return
        self._desk.enable(Mode.BRINGUP, clear_stop=self._clear_stop)
        kicks = [kick for output in (LEFT, RIGHT) if (kick := self._kick(output)) is not None]
        self._desk.stop()
        yield from judge_kicks(kicks)

    def _kick(self, output: str) -> Kick | None:
        desk, duty = self._desk, KICK_DUTY
        if not self._person.confirm(f"Output {output.upper()} next: watch the wheels. Ready?"):
            return None
        before = desk.await_newest(Encoders)
        readings = desk.watch(Encoders)
        desk.duties(*((duty, 0.0) if output == LEFT else (0.0, duty)))
        desk.run(KICK_S)
        desk.duties(0.0, 0.0)
        desk.run(0.5)
        desk.unwatch(readings)
        left, right = _turned(before, [m for _, m in readings if isinstance(m, Encoders)])
        said = self._person.choose("Which wheel turned, and which way?", _TURNED)
        wheel = {"l": LEFT, "r": RIGHT}.get(said[0], "none")
        return Kick(output, wheel, said.endswith("f"), left, right)

    # ---- by hand --------------------------------------------------------------------------

    def _axes(self) -> Iterator[Finding]:
        rest = self._at_rest()
        if rest is None:
            advice = "put it down, and touch it only after the question"
            yield left_out("imu axes", "the robot does not stand still", advice)
            return
        yield self._by_hand(
            "imu turn",
            "Turn the whole robot by a quarter COUNTER-CLOCKWISE, seen from above.",
            "+z",
            TURN_RAD,
            _Rotation(rest),
        )
        for step, text, wanted in (
            ("imu nose", "Raise the robot's FRONT by a hand's width.", "+x"),
            ("imu side", "Raise the robot's LEFT side by a hand's width.", "+y"),
        ):
            yield self._by_hand(step, text, wanted, TILT_M_S2, _Tilt(rest))

    def _at_rest(self) -> ImuSample | None:
        """Mean reading at rest: the gyro's bias, and gravity; None: the robot is moved."""
        self._person.show("Let the robot stand level and still.")
        for _ in range(REST_TRIES):
            samples = self._rest_readings()
            try:
                x, y, z = biases([(t_s, sample.gyro) for t_s, sample in samples])
            except BridgeError as error:
                self._person.show(str(error))
                continue
            gravity = _mean_accel([sample for _, sample in samples])
            return ImuSample(gravity, (x.bias_rad_s, y.bias_rad_s, z.bias_rad_s))
        return None

    def _rest_readings(self) -> list[tuple[float, ImuSample]]:
        kept = self._desk.watch(Imu)
        self._desk.run(REST_S)
        self._desk.run(HAND_S, lambda: len(kept) >= MIN_SAMPLES)
        self._desk.unwatch(kept)
        return [(t_s, _sample(m)) for t_s, m in kept if isinstance(m, Imu)]

    def _by_hand(
        self, step: str, text: str, wanted: str, least: float, motion: _Rotation | _Tilt
    ) -> Finding:
        if not self._person.confirm(f"{text} Ready (no: leave it out)?"):
            return left_out(step, "not tried")
        kept = self._desk.watch(Imu)
        taken = 0

        def answered() -> bool:
            nonlocal taken
            for t_s, message in kept[taken:]:
                if isinstance(message, Imu):
                    motion.add(t_s, _sample(message))
            taken = len(kept)
            return abs(strongest(motion.values).value) >= least

        self._desk.run(HAND_S, answered)
        self._desk.unwatch(kept)
        return judge_axis(step, motion.values, wanted, least)

    # ---- sensors --------------------------------------------------------------------------

    def _sensors(self) -> Iterator[Finding]:
        hand = "Hold a hand 10 cm before the"
        yield self._sense("ultrasonic", f"{hand} FRONT sensor.", _front_near, {})
        yield self._sense(
            "infrared left", f"{hand} LEFT sensor.", _left_near, {"the right one": _right_near}
        )
        yield self._sense(
            "infrared right", f"{hand} RIGHT sensor.", _right_near, {"the left one": _left_near}
        )
        for side, bit, other in (
            (LEFT, Contact.BUMPER_LEFT, Contact.BUMPER_RIGHT),
            (RIGHT, Contact.BUMPER_RIGHT, Contact.BUMPER_LEFT),
        ):
            yield self._sense(
                f"bumper {side}",
                f"Press the {side.upper()} half of the bumper.",
                _has(bit),
                {f"the {RIGHT if side == LEFT else LEFT} one": _has(other)},
            )
        yield self._sense(
            "cliff",
            "Let the floor sensor see a floor (a sheet of paper under it), then nothing.",
            _has(Contact.CLIFF),
            {},
            first=lambda r: not r.contacts & Contact.CLIFF,
        )

    def _sense(
        self,
        step: str,
        text: str,
        wanted: Callable[[Range], bool],
        others: dict[str, Callable[[Range], bool]],
        first: Callable[[Range], bool] | None = None,
    ) -> Finding:
        """Wait for a reading; ``others`` are what a swapped plug would give."""
        desk = self._desk
        if first is None and (pressed := self._before_anybody(step, wanted)) is not None:
            return pressed
        before = desk.await_newest(Range)
        already = {name for name, test in others.items() if test(before)}
        if not self._person.confirm(f"{text} Ready (no: leave it out)?"):
            return left_out(step, "not tried")
        if first is not None and not desk.run(HAND_S, lambda: first(desk.await_newest(Range))):
            return wrong(step, "never sees a floor", "look at its supply, its wire and its level")
        other = ""

        def answered() -> bool:
            nonlocal other
            reading = desk.await_newest(Range)
            if wanted(reading):
                return True
            other = next((n for n, t in others.items() if n not in already and t(reading)), "")
            return bool(other)

        if not desk.run(HAND_S, answered):
            return wrong(step, "does not answer", "look at its supply and its wire")
        if other:
            return wrong(step, f"{other} answers", "left and right are swapped: cross their plugs")
        return good(step, "answers")

    def _before_anybody(self, step: str, wanted: Callable[[Range], bool]) -> Finding | None:
        """What answers already; the hand of the look before may still be there for a while."""
        desk = self._desk
        if desk.run(RELEASE_S, lambda: not wanted(desk.await_newest(Range))):
            return None
        if not step.startswith("bumper"):
            return left_out(step, "something is near already", "move the robot away from it")
        advice = "free it, or look for a short in its wire; a swapped level reads so too"
        return wrong(step, "answers before anybody is near", advice)

    # ---- wheel control --------------------------------------------------------------------

    def _control(self) -> Iterator[Finding]:
        bad = [
            f for f in self.findings if f.ok is False and f.step.startswith(("motor", "encoder"))
        ]
        if bad:
            yield left_out(
                "wheel control", "motors or encoders are wired wrongly", "mend them first"
            )
            return
        if not self._off_floor(f"Both wheels will turn at {STEP_M_S:g} m/s for {STEP_S:g} s."):
            yield left_out("wheel control", "the wheels are not free")
            return
        try:
            self._desk.enable(Mode.VELOCITY, clear_stop=self._clear_stop)
        except CommandRejectedError as error:
            advice = "lifted? cover the floor sensor, so that the device takes itself to stand"
            yield left_out("wheel control", f"the device refuses to drive ({error.reason})", advice)
            return
        try:
            self.steps = self._step()
        except (StoppedForSafetyError, ValueError) as error:
            if getattr(error, "exit_status", 1) == 0:
                raise
            yield wrong("wheel control", str(error), "see its log lines above")
        finally:
            self._desk.stop()
        for step in self.steps:
            yield judge_step(step)

    def _step(self) -> tuple[WheelStep, ...]:
        desk = self._desk
        encoders = desk.session.link.codec.catalogue.by_class[Encoders].type_id
        desk.client.command(SetStreamRate, encoders, 1000, what="encoders at 100 Hz")
        kept = desk.watch(Encoders)
        desk.steer(lambda: (0.0, 0.0))
        desk.run(0.3)
        step_s = kept[-1][0] if kept else 0.0
        desk.steer(lambda: (STEP_M_S, 0.0))
        desk.run(STEP_S)
        desk.steer(lambda: (0.0, 0.0))
        desk.run(0.5)
        desk.unwatch(kept)
        end_s = step_s + STEP_S
        samples = [
            (t_s, m.left, m.right) for t_s, m in kept if isinstance(m, Encoders) and t_s <= end_s
        ]
        return wheel_steps(samples, step_s, STEP_M_S, self._model.metres_per_count)


class _Signed(NamedTuple):
    left: int
    right: int


def _turned(before: Encoders, readings: list[Encoders]) -> _Signed:
    left = right = 0
    last = before
    for reading in readings:
        left += encoder_delta(last.left, reading.left)
        right += encoder_delta(last.right, reading.right)
        last = reading
    return _Signed(left, right)


def _sample(message: Imu) -> ImuSample:
    return ImuSample(
        (message.accel_x_m_s2, message.accel_y_m_s2, message.accel_z_m_s2),
        (message.gyro_x_rad_s, message.gyro_y_rad_s, message.gyro_z_rad_s),
    )


class _Rotation:
    """Angle about each axis (rad), less the gyro's bias as it was at rest.

    A bias of 3 °/s that is left in looks like a quarter turn after half a minute. What two seconds
    of rest leave of it is below 1° in the time that a hand has.
    """

    def __init__(self, rest: ImuSample) -> None:
        self._bias = rest.gyro
        self._last_s: float | None = None
        self.values = (0.0, 0.0, 0.0)

    def add(self, t_s: float, sample: ImuSample) -> None:
        """Take the next reading, with the device's time."""
        step_s = 0.0 if self._last_s is None else t_s - self._last_s
        self._last_s = t_s
        x, y, z = (
            angle + (rate - bias) * step_s
            for angle, rate, bias in zip(self.values, sample.gyro, self._bias, strict=True)
        )
        self.values = x, y, z


_TILT_SAMPLES = 30
"""Readings that a tilt must last, 0.3 s at 100 Hz: a knock is over before."""


class _Tilt:
    """How far gravity moved from its direction at rest, m/s², along the two level axes."""

    def __init__(self, rest: ImuSample) -> None:
        self._rest = rest.accel
        self._newest: deque[ImuSample] = deque(maxlen=_TILT_SAMPLES)

    def add(self, _t_s: float, sample: ImuSample) -> None:
        """Take the next reading."""
        self._newest.append(sample)

    @property
    def values(self) -> tuple[float, float, float]:
        """Of the newest readings; zeros until there are enough."""
        if len(self._newest) < _TILT_SAMPLES:
            return 0.0, 0.0, 0.0
        now = _mean_accel(self._newest)
        # Whatever is tilted, the axis that was up loses a little: it is never the one that rises.
        up = max(range(3), key=lambda i: abs(self._rest[i]))
        x, y, z = (0.0 if i == up else now[i] - self._rest[i] for i in range(3))
        return x, y, z


def _mean_accel(samples: Collection[ImuSample]) -> tuple[float, float, float]:
    x, y, z = (fmean(sample.accel[i] for sample in samples) for i in range(3))
    return x, y, z


_HAND_M = 0.2


def _near(value: float | None) -> bool:
    return value is not None and value < _HAND_M


def _front_near(reading: Range) -> bool:
    return _near(reading.ultrasonic_m)


def _left_near(reading: Range) -> bool:
    return _near(reading.infrared_left_m)


def _right_near(reading: Range) -> bool:
    return _near(reading.infrared_right_m)


def _has(bit: Contact) -> Callable[[Range], bool]:
    return lambda reading: bool(reading.contacts & bit)
