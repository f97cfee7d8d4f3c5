"""Bring-up with the wheels off the floor, as a sequence of checks with findings.

No wheel turns before the person beside the robot has allowed it. The procedure asks the person
about facts that no sensor measures: which wheel turned, and in which direction.
"""

from __future__ import annotations

import math
from collections import deque
from statistics import fmean
from typing import TYPE_CHECKING

from bridge.bringup.first_power import FirstPower
from bridge.bringup.gyro import MIN_SAMPLES, biases
from bridge.bringup.port import InterruptedByPersonError
from bridge.bringup.wheel_step import WheelStep, judge_step, wheel_steps
from bridge.bringup.wiring import (
    LEFT,
    RIGHT,
    CheckResult,
    ImuSample,
    Kick,
    good,
    judge_axis,
    judge_kicks,
    judge_power,
    judge_rest,
    left_out,
    strongest,
    turned,
    wrong,
)
from bridge.errors import BridgeError, CommandRejectedError, StoppedForSafetyError
from protocol.messages.device import Encoders, Imu, Power, Range, Status
from protocol.messages.host import SetStreamRate
from protocol.messages.values import Contact, Fault, Mode, fault_labels

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

    from bridge.bringup.person import Person
    from bridge.bringup.session import BringupSession
    from bridge.motion.robot_model import RobotModel

STEPS = ("first-power", "supply", "rest", "motors", "axes", "sensors", "control")
"""The checks in their order. Each check depends on the previous check."""
USUAL_STEPS = STEPS[1:]
"""The checks for a robot whose motors have already run."""
REST_S = 2.0
"""Duration of a measurement at standstill, s."""
REST_TRIES = 5
"""Maximum number of attempts to measure at standstill while the robot is touched. After them, the
check of the axes is skipped."""
KICK_DUTY = 0.3
"""Duty of a kick, -1..1. In ``KICK_S`` the wheel's rim moves about 6 cm, which is visible."""
KICK_S = 0.8
"""Duration of a kick, s."""
HAND_S = 20.0
"""Maximum time for a requested action of the person, s."""
RELEASE_S = 4.0
"""Maximum time until the person's hand has left the previous sensor, s."""
TURN_RAD = math.radians(45.0)
"""Minimum turn that counts as the requested quarter turn, rad."""
TILT_M_S2 = 2.5
"""Minimum change of gravity along an axis that counts as a tilt, m/s². It is a tilt of about
15°."""
STEP_M_S = 0.15
"""Speed setpoint of the step for the wheel control, m/s."""
STEP_S = 1.5
"""Duration of the step, s."""
_TURNED = {
    "lf": "the LEFT wheel, forwards",
    "lb": "the LEFT wheel, backwards",
    "rf": "the RIGHT wheel, forwards",
    "rb": "the RIGHT wheel, backwards",
    "n": "neither",
}


class BringUp:
    """The bring-up procedure; its results are ``findings`` and ``steps``."""

    def __init__(
        self,
        session: BringupSession,
        person: Person,
        model: RobotModel,
        *,
        clear_stop: bool = False,
    ) -> None:
        """Prepare the procedure; nothing moves before :meth:`run`."""
        self._session, self._person, self._model = session, person, model
        self._clear_stop = clear_stop
        self._asked_off_floor = False
        self.findings: list[CheckResult] = []
        self.steps: tuple[WheelStep, ...] = ()

    def run(self, wanted: tuple[str, ...] = USUAL_STEPS) -> list[CheckResult]:
        """Run the requested checks in their order.

        Raises:
            DeviceLostError: the device was lost.
            StoppedForSafetyError: the device stopped by itself, or a stop is latched.
            CommandRejectedError: the device rejected a command.
            InterruptedByPersonError: the person interrupted the procedure.

        """
        looks: dict[str, Callable[[], Iterator[CheckResult]]] = {
            "first-power": self._first_power,
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
                if name == "first-power" and not all(f.ok for f in self.findings):
                    break  # no other step supplies power to a robot with a known fault
        return self.findings

    @property
    def well(self) -> bool:
        """True if no check failed."""
        return all(f.ok is not False for f in self.findings)

    def _note(self, finding: CheckResult) -> None:
        self.findings.append(finding)
        self._person.report(finding)

    def _first_power(self) -> Iterator[CheckResult]:
        checklist = FirstPower(
            self._session, self._person, self._model, clear_stop=self._clear_stop
        )
        yield from checklist.results()

    # ---- checks without help --------------------------------------------------------------

    def _supply(self) -> Iterator[CheckResult]:
        power = self._session.await_newest(Power)
        currents = power.motor_left_a, power.motor_right_a
        yield from judge_power(power.battery_v, power.logic_v, currents, self._model.battery_v)

    def _rest(self) -> Iterator[CheckResult]:
        self._person.show("Let the robot stand level and still.")
        counts = self._session.watch(Encoders)
        readings = self._session.collect(Imu, REST_S)
        self._session.unwatch(counts)
        yield from judge_rest([_sample(message) for _, message in readings])
        moved = {(m.left, m.right) for _, m in counts if isinstance(m, Encoders)}
        if len(moved) > 1:
            advice = "check that no wheel turns; else check the encoders' supply and shielding"
            yield wrong("encoders at standstill", "the counts change", advice)
        elif moved:
            yield good("encoders at standstill", "the counts are constant")
        faults = fault_labels(self._session.await_newest(Status).faults & ~int(Fault.LIFTED))
        if faults:
            yield wrong("device", f"reports {', '.join(faults)}", "see its log lines above")

    # ---- motors and encoders --------------------------------------------------------------

    def _off_floor(self, what: str) -> bool:
        text = f"{what} Are BOTH WHEELS OFF THE FLOOR and free to turn?"
        self._asked_off_floor = self._asked_off_floor or self._person.confirm(text)
        return self._asked_off_floor

    def _motors(self) -> Iterator[CheckResult]:
        if not self._off_floor("Each wheel will now be turned for a moment."):
            yield left_out("motors", "the wheels are not free to turn")
            return
        self._session.enable(Mode.BRINGUP, clear_stop=self._clear_stop)
        kicks = [kick for output in (LEFT, RIGHT) if (kick := self._kick(output)) is not None]
        self._session.stop()
        yield from judge_kicks(kicks)

    def _kick(self, output: str) -> Kick | None:
        session, duty = self._session, KICK_DUTY
        if not self._person.confirm(f"Output {output.upper()} next: watch the wheels. Ready?"):
            return None
        before = session.await_newest(Encoders)
        readings = session.watch(Encoders)
        session.duties(*((duty, 0.0) if output == LEFT else (0.0, duty)))
        session.run(KICK_S)
        session.duties(0.0, 0.0)
        session.run(0.5)
        session.unwatch(readings)
        left, right = turned(before, readings)
        answer = self._person.choose("Which wheel turned, and in which direction?", _TURNED)
        wheel = {"l": LEFT, "r": RIGHT}.get(answer[0], "none")
        return Kick(output, wheel, answer.endswith("f"), left, right)

    # ---- by hand --------------------------------------------------------------------------

    def _axes(self) -> Iterator[CheckResult]:
        rest = self._at_rest()
        if rest is None:
            advice = "put the robot down, and touch it only when asked"
            yield left_out("imu axes", "the robot is not still", advice)
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
        """Return gravity and the gyro's biases at standstill; None if the robot keeps moving."""
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
        kept = self._session.watch(Imu)
        self._session.run(REST_S)
        self._session.run(HAND_S, lambda: len(kept) >= MIN_SAMPLES)
        self._session.unwatch(kept)
        return [(t_s, _sample(m)) for t_s, m in kept if isinstance(m, Imu)]

    def _by_hand(
        self, step: str, text: str, wanted: str, minimum: float, motion: _Rotation | _Tilt
    ) -> CheckResult:
        if not self._person.confirm(f"{text} Ready (no: skip)?"):
            return left_out(step, "skipped")
        kept = self._session.watch(Imu)
        taken = 0

        def answered() -> bool:
            nonlocal taken
            for t_s, message in kept[taken:]:
                if isinstance(message, Imu):
                    motion.add(t_s, _sample(message))
            taken = len(kept)
            return abs(strongest(motion.values).value) >= minimum

        self._session.run(HAND_S, answered)
        self._session.unwatch(kept)
        return judge_axis(step, motion.values, wanted, minimum)

    # ---- sensors --------------------------------------------------------------------------

    def _sensors(self) -> Iterator[CheckResult]:
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
                f"Press the {side.upper()} bumper switch.",
                _has(bit),
                {f"the {RIGHT if side == LEFT else LEFT} one": _has(other)},
            )
        yield self._sense(
            "cliff",
            "Cover all cliff sensors with paper, then uncover one of them.",
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
    ) -> CheckResult:
        """Wait for a reading; ``others`` are the readings that swapped plugs would cause."""
        session = self._session
        if first is None and (early := self._early_response(step, wanted)) is not None:
            return early
        before = session.await_newest(Range)
        already = {name for name, test in others.items() if test(before)}
        if not self._person.confirm(f"{text} Ready (no: skip)?"):
            return left_out(step, "skipped")
        if first is not None and not session.run(
            HAND_S, lambda: first(session.await_newest(Range))
        ):
            return wrong(step, "never sees a floor", "check its supply, wire and signal level")
        other = ""

        def answered() -> bool:
            nonlocal other
            reading = session.await_newest(Range)
            if wanted(reading):
                return True
            other = next((n for n, t in others.items() if n not in already and t(reading)), "")
            return bool(other)

        if not session.run(HAND_S, answered):
            return wrong(step, "does not respond", "check its supply and its wire")
        if other:
            return wrong(step, f"{other} responds", "left and right are swapped: cross their plugs")
        return good(step, "responds")

    def _early_response(self, step: str, wanted: Callable[[Range], bool]) -> CheckResult | None:
        """Return a finding for a sensor that responds before the person's action; else None.

        After the previous check, the person's hand may be near the sensor for a short time.
        """
        session = self._session
        if session.run(RELEASE_S, lambda: not wanted(session.await_newest(Range))):
            return None
        if not step.startswith("bumper"):
            return left_out(step, "an object is already near", "move the robot away from it")
        advice = "free it, or look for a short circuit or an inverted signal level"
        return wrong(step, "responds before it is pressed", advice)

    # ---- wheel control --------------------------------------------------------------------

    def _control(self) -> Iterator[CheckResult]:
        bad = [
            f for f in self.findings if f.ok is False and f.step.startswith(("motor", "encoder"))
        ]
        if bad:
            yield left_out(
                "wheel control", "motors or encoders are wired wrongly", "correct the wiring first"
            )
            return
        if not self._off_floor(f"Both wheels will turn at {STEP_M_S:g} m/s for {STEP_S:g} s."):
            yield left_out("wheel control", "the wheels are not free to turn")
            return
        if not self._sees_floor():
            advice = "cover the cliff sensor; without a floor the device does not drive forwards"
            yield left_out("wheel control", "the cliff sensor sees no floor", advice)
            return
        try:
            self._session.enable(Mode.VELOCITY, clear_stop=self._clear_stop)
        except CommandRejectedError as error:
            text = f"the device rejected the command ({error.reason})"
            yield left_out("wheel control", text, "see its log lines above")
            return
        try:
            self.steps = self._step()
        except InterruptedByPersonError:
            raise
        except (StoppedForSafetyError, ValueError) as error:
            yield wrong("wheel control", str(error), "see its log lines above")
        finally:
            self._session.stop()
        for step in self.steps:
            yield judge_step(step)

    def _sees_floor(self) -> bool:
        """Return True if the cliff sensor detects a floor.

        On a stand, the person covers the sensor.
        """
        session = self._session

        def seen() -> bool:
            return not session.await_newest(Range).contacts & Contact.CLIFF

        text = "COVER the cliff sensor with paper, and leave it there. Ready?"
        return seen() or (self._person.confirm(text) and session.run(HAND_S, seen))

    def _step(self) -> tuple[WheelStep, ...]:
        session = self._session
        encoders = session.session.link.codec.catalogue.by_class[Encoders].type_id
        session.client.command(SetStreamRate, encoders, 1000, what="encoders at 100 Hz")
        kept = session.watch(Encoders)
        session.steer(lambda: (0.0, 0.0))
        session.run(0.3)
        step_s = kept[-1][0] if kept else 0.0
        session.steer(lambda: (STEP_M_S, 0.0))
        session.run(STEP_S)
        session.steer(lambda: (0.0, 0.0))
        session.run(0.5)
        session.unwatch(kept)
        end_s = step_s + STEP_S
        samples = [
            (t_s, m.left, m.right) for t_s, m in kept if isinstance(m, Encoders) and t_s <= end_s
        ]
        return wheel_steps(samples, step_s, STEP_M_S, self._model.metres_per_count)


def _sample(message: Imu) -> ImuSample:
    return ImuSample(
        (message.accel_x_m_s2, message.accel_y_m_s2, message.accel_z_m_s2),
        (message.gyro_x_rad_s, message.gyro_y_rad_s, message.gyro_z_rad_s),
    )


class _Rotation:
    """Integrates the angle about each axis (rad), without the gyro's bias at standstill.

    In half a minute, an uncorrected bias of 3 °/s would integrate to a quarter turn. The bias is
    measured during two seconds of standstill, so the error stays below 1° in ``HAND_S``.
    """

    def __init__(self, rest: ImuSample) -> None:
        self._bias = rest.gyro
        self._last_s: float | None = None
        self.values = (0.0, 0.0, 0.0)

    def add(self, t_s: float, sample: ImuSample) -> None:
        """Add the next sample with its device time."""
        step_s = 0.0 if self._last_s is None else t_s - self._last_s
        self._last_s = t_s
        x, y, z = (
            angle + (rate - bias) * step_s
            for angle, rate, bias in zip(self.values, sample.gyro, self._bias, strict=True)
        )
        self.values = x, y, z


_TILT_SAMPLES = 30
"""Minimum number of samples in a tilt. They are 0.3 s at 100 Hz, which is longer than a knock."""


class _Tilt:
    """Change of gravity along the two horizontal axes since standstill, m/s²."""

    def __init__(self, rest: ImuSample) -> None:
        self._rest = rest.accel
        self._newest: deque[ImuSample] = deque(maxlen=_TILT_SAMPLES)

    def add(self, _t_s: float, sample: ImuSample) -> None:
        """Add the next sample."""
        self._newest.append(sample)

    @property
    def values(self) -> tuple[float, float, float]:
        """Mean change over the newest samples; zeros if there are too few samples."""
        if len(self._newest) < _TILT_SAMPLES:
            return 0.0, 0.0, 0.0
        now = _mean_accel(self._newest)
        # A tilt only slightly reduces the vertical component. So the vertical axis is set to zero.
        up = max(range(3), key=lambda i: abs(self._rest[i]))
        x, y, z = (0.0 if i == up else now[i] - self._rest[i] for i in range(3))
        return x, y, z


def _mean_accel(samples: Collection[ImuSample]) -> tuple[float, float, float]:
    x, y, z = (fmean(sample.accel[i] for sample in samples) for i in range(3))
    return x, y, z


_HAND_M = 0.2
"""Distance below which a hand is detected, m."""


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
