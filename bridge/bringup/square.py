"""Driving of UMBmark's straight path and squares, steered by wheel odometry only.

The gyro is not used, because the calibration measures the error of the wheels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, Protocol

from bridge.bringup.umbmark import (
    Benchmark,
    Correction,
    SquareRun,
    benchmark,
    borenstein,
    refine,
    refutation,
    scatter_m,
    straight_scale,
)
from bridge.errors import BridgeError, StoppedForSafetyError
from bridge.motion.control.executor import LegExecutor
from bridge.motion.estimation.odometry import advance_arc, encoder_delta
from bridge.motion.geometry import Pose2, wrap_angle
from bridge.motion.legs import Drive, Leg, LegResult, StopReason, Turn
from bridge.motion.observation import Observation
from protocol.messages.device import Encoders, Range
from protocol.messages.values import Contact, Mode, StopCause

if TYPE_CHECKING:
    from bridge.bringup.person import Person
    from bridge.bringup.session import BringupSession
    from bridge.motion.robot_model import RobotModel
    from protocol.schema.message import Message

REST_S = 0.6
"""Duration of the standstill before and after each drive, s."""
_LEG_S = 20.0
"""Additional time limit of one leg, s: turns, acceleration and braking."""
_FINE = frozenset({StopReason.DONE, StopReason.DISTANCE})
"""Stop reasons that are a normal end of a leg."""
_LOWPASS = 0.5
"""Smoothing factor of the measured speeds."""
_SCALE_ROUNDS = 3
"""Number of iterations over scale and correction, which depend on each other."""


class Measure(Protocol):
    """Measures the true displacement of the robot."""

    def begin(self) -> None:
        """Use the current position as the mark."""

    def end(self) -> tuple[float, float]:
        """Return the displacement from the mark, forwards and to the left, m."""


class ByTape:
    """Measurement by a person with a tape."""

    def __init__(self, person: Person) -> None:
        self._person = person

    def begin(self) -> None:
        """Do nothing, because the person has confirmed that the robot is on the mark."""

    def end(self) -> tuple[float, float]:
        """Ask for the displacement in millimetres."""
        ahead = self._person.number("Distance AHEAD of the mark (mm; behind: -)")
        left = self._person.number("Distance to the LEFT of the mark (mm; to the right: -)")
        return 0.001 * ahead, 0.001 * left


class SquareResult(NamedTuple):
    """Result of the calibration."""

    scale: float | None
    """Scale of both wheel diameters (E_s of UMBmark); None if no straight path was measured."""
    runs: tuple[SquareRun, ...]
    before: Benchmark
    first: Correction
    """Correction by the closed-form equations of Borenstein and Feng (``umbmark.py``)."""
    correction: Correction
    """The refined correction, which ``model`` contains."""
    after: Benchmark
    """Errors of ``runs``, evaluated again with ``model``."""
    model: RobotModel
    verified: Benchmark | None = None
    """Errors of new runs, driven and evaluated with ``model``."""
    refuted: str | None = None
    """Reason why the new runs contradict ``model``; such a result must not be written."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """Options of the calibration."""

    side_m: float = 2.0
    runs: int = 5
    """Number of squares in each direction."""
    speed_m_s: float = 0.15
    straight: bool = True
    verify: bool = False


class Wheels:
    """Wheel odometry of one drive."""

    def __init__(self, session: BringupSession, model: RobotModel) -> None:
        """Use the current pose as the origin."""
        self._model = model
        self._kept: list[tuple[float, Message]] = session.watch(Encoders)
        self._last = session.await_newest(Encoders)
        self._last_s: float | None = None
        self.counts: list[tuple[int, int]] = []
        self.pose = Pose2(0.0, 0.0, 0.0)
        self.v_m_s = self.yaw_rate_rad_s = 0.0

    @property
    def kept(self) -> list[tuple[float, Message]]:
        """Received messages that are not yet processed; the session appends to this list."""
        return self._kept

    def update(self) -> None:
        """Process the encoder readings received since the last call."""
        model = self._model
        for t_s, message in self._kept:
            if not isinstance(message, Encoders):
                continue
            step = (
                encoder_delta(self._last.left, message.left),
                encoder_delta(self._last.right, message.right),
            )
            self.counts.append(step)
            left = model.left_metres_per_count * step[0]
            right = model.right_metres_per_count * step[1]
            distance, turn = 0.5 * (left + right), (right - left) / model.wheel_base_m
            self.pose = advance_arc(self.pose, distance, turn)
            if self._last_s is not None and t_s > self._last_s:
                dt_s = t_s - self._last_s
                self.v_m_s += _LOWPASS * (distance / dt_s - self.v_m_s)
                self.yaw_rate_rad_s += _LOWPASS * (turn / dt_s - self.yaw_rate_rad_s)
            self._last, self._last_s = message, t_s
        self._kept.clear()


class Squares:
    """The calibration procedure: drives, measures and computes the correction."""

    def __init__(
        self,
        session: BringupSession,
        person: Person,
        model: RobotModel,
        measure: Measure,
        *,
        clear_stop: bool = False,
    ) -> None:
        """Prepare the procedure; nothing moves before :meth:`run`."""
        self._session, self._person, self._measure = session, person, measure
        self._model = model
        self._clear_stop = clear_stop
        self._driven = False

    def run(self, asked: Asked) -> SquareResult:
        """Drive the squares and compute the correction.

        Raises:
            BridgeError: the person declined, or a run failed.
            StoppedForSafetyError: the robot touched something, or the device stopped.
            DeviceLostError: the device was lost.

        """
        model, side_m = self._model, asked.side_m
        room_m = side_m + 2.0 * model.robot_diameter_m
        self._confirm(
            f"The robot will DRIVE squares of {side_m:g} m at {asked.speed_m_s:g} m/s, first to "
            f"its right, then to its left: it needs {room_m:.1f} m of free floor on both sides. "
            "Is it free?"
        )
        straight = self._straight(model, asked) if asked.straight else None
        runs = self._squares(model, asked)
        before = benchmark(model, runs)
        first = borenstein(model, runs, side_m)
        scaled, scale, correction = model, 1.0, refine(model, runs, first)
        if straight is not None:
            # A robot with unequal wheels drives an arc. Its chord gives the scale only if the ratio
            # of the wheels is known. The wheel base depends on the scale, so iterate.
            for _ in range(_SCALE_ROUNDS):
                scale *= straight_scale(correction.applied_to(scaled), *straight)
                scaled = replace(model, wheel_diameter_m=model.wheel_diameter_m * scale)
                correction = refine(scaled, runs, correction)
        corrected = correction.applied_to(scaled)
        result = SquareResult(
            None if straight is None else scale,
            runs,
            before,
            first,
            correction,
            benchmark(corrected, runs),
            corrected,
        )
        if asked.verify:
            self._person.show("Next: the same squares with the corrected model.")
            again = self._squares(corrected, asked)
            verified = benchmark(corrected, again)
            scattered = [scatter_m(corrected, each) for each in (runs, again)]
            centre_m = math.hypot(*scattered) / math.sqrt(asked.runs)
            refuted = refutation(before, result.after, verified, centre_m)
            result = result._replace(verified=verified, refuted=refuted)
        return result

    def _confirm(self, text: str) -> None:
        if not self._person.confirm(text):
            driven = "" if self._driven else "nothing was driven and "
            raise BridgeError(f"ended: {driven}nothing changed")

    def _straight(
        self, model: RobotModel, asked: Asked
    ) -> tuple[tuple[tuple[int, int], ...], float]:
        """Drive straight; return the encoder counts and the measured distance, m."""
        self._confirm("STRAIGHT AHEAD next. Put the robot on its mark. Ready?")
        self._measure.begin()
        counts = self._drive(model, asked, (Drive(0.0, asked.side_m, asked.speed_m_s),))
        return counts, math.hypot(*self._measure.end())

    def _squares(self, model: RobotModel, asked: Asked) -> tuple[SquareRun, ...]:
        runs = []
        for clockwise in (True, False):
            direction = "to the RIGHT (clockwise)" if clockwise else "to the LEFT"
            for number in range(asked.runs):
                self._confirm(
                    f"Square {number + 1} of {asked.runs} {direction}. "
                    "Put the robot on its mark. Ready?"
                )
                self._measure.begin()
                counts = self._drive(
                    model, asked, square(asked.side_m, asked.speed_m_s, clockwise=clockwise)
                )
                runs.append(SquareRun(clockwise, counts, *self._measure.end()))
        return tuple(runs)

    def _drive(
        self, model: RobotModel, asked: Asked, legs: tuple[Leg, ...]
    ) -> tuple[tuple[int, int], ...]:
        """Drive legs by wheel odometry only; return the encoder counts."""
        session = self._session
        self._driven = True
        session.enable(Mode.VELOCITY, clear_stop=self._clear_stop)
        tuned = replace(model, cruise_speed_m_s=min(asked.speed_m_s, model.max_speed_m_s))
        wheels, executor = Wheels(session, model), LegExecutor(tuned)

        def steer() -> tuple[float, float]:
            wheels.update()
            command = executor.step(self._observe(wheels))
            return command.v_m_s, command.yaw_rate_rad_s

        session.steer(lambda: (0.0, 0.0))
        session.run(REST_S)
        wheels.update()
        for leg in legs:
            executor.start(leg, self._observe(wheels))
            session.steer(steer)
            session.run(_limit_s(leg, asked.speed_m_s), lambda: executor.result is not None)
            self._check(leg, executor.result)
        session.steer(lambda: (0.0, 0.0))
        session.run(REST_S)
        wheels.update()
        session.unwatch(wheels.kept)
        session.stop()
        return tuple(wheels.counts)

    def _check(self, leg: Leg, result: LegResult | None) -> None:
        if result is None or result.reason not in _FINE:
            why = "did not end in time" if result is None else f"ended: {result.reason.value}"
            self._session.stop(StopCause.SUPERVISE)
            raise StoppedForSafetyError(f"a {leg.purpose} of the square {why}")

    def _observe(self, wheels: Wheels) -> Observation:
        reading = self._session.latest(Range)
        bits = 0 if reading is None else reading.contacts
        return Observation(
            self._session.now_s,
            wheels.pose,
            wheels.v_m_s,
            wheels.yaw_rate_rad_s,
            None if reading is None else reading.ultrasonic_m,
            None,
            None,
            bool(bits & Contact.BUMPER_LEFT),
            bool(bits & Contact.BUMPER_RIGHT),
            bool(bits & Contact.CLIFF),
        )


def square(side_m: float, speed_m_s: float, *, clockwise: bool) -> tuple[Leg, ...]:
    """Return the legs of a square: four sides and four turns, starting along x."""
    legs: list[Leg] = []
    heading = 0.0
    for _ in range(4):
        legs.append(Drive(heading, side_m, speed_m_s, purpose="side"))
        heading = wrap_angle(heading + (-0.5 if clockwise else 0.5) * math.pi)
        legs.append(Turn(heading))
    return tuple(legs)


def _limit_s(leg: Leg, speed_m_s: float) -> float:
    """Return the time limit of a leg, s."""
    length_m = leg.distance_m if isinstance(leg, Drive) else None
    return _LEG_S + 2.0 * abs(length_m or 0.0) / speed_m_s
