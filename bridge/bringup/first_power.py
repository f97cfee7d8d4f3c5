"""First power: a checklist for a board and motors that have never run together.

Each check supplies more power than the previous check. The first check that fails or is declined
ends the list, so that no later check supplies more power to a robot with a known fault.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from bridge.bringup.port import InterruptedByPersonError
from bridge.bringup.wiring import (
    LEFT,
    MIN_COUNTS,
    RIGHT,
    CheckResult,
    Counts,
    Kick,
    good,
    judge_encoder,
    judge_power,
    judge_stage,
    last_change_s,
    left_out,
    turned,
    wrong,
)
from bridge.errors import StoppedForSafetyError
from protocol.messages.device import Encoders, Power, Status
from protocol.messages.values import Fault, Mode, fault_labels

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from bridge.bringup.person import Person
    from bridge.bringup.session import BringupSession
    from bridge.motion.robot_model import RobotModel

STAGES = (0.1, 0.2, 0.3)
"""Duties of the stages, relative to full duty. The device limits a duty in bring-up mode to 0.5."""
STAGE_S = 0.6
"""Duration of one duty, s. It is three readings of the currents at their slowest rate of 5 Hz."""
REST_S = 1.0
"""Time between two duties, and duration of a check at standstill, s."""
HAND_S = 30.0
"""Maximum time in which the person turns a wheel by hand, s."""
STANDS_S = 1.0
"""Maximum time from the end of the duties to standstill, s. It is the sum of 0.2 s until the
device's timeout and the time in which a free wheel stops."""

_PULL_DOWNS = (
    "Is a pull-down resistor of 10 kΩ fitted from each enable input of the motor driver (ENA, ENB) "
    "to ground?"
)
_BEFORE = (
    (
        "pull-downs",
        _PULL_DOWNS,
        "fit them; without them a motor may run while the microcontroller is in reset",
    ),
    (
        "wheels free",
        "Are BOTH WHEELS OFF THE FLOOR and free to turn?",
        "put the robot on a stand",
    ),
    (
        "motor supply off",
        "Is the supply of the motor driver switched OFF or unplugged?",
        "switch it off, and begin again",
    ),
)
"""Conditions that the person confirms before anything is measured: name, question, remedy."""


class FirstPower:
    """The checklist; :meth:`results` runs it."""

    def __init__(
        self,
        session: BringupSession,
        person: Person,
        model: RobotModel,
        *,
        clear_stop: bool = False,
    ) -> None:
        """Prepare the checklist; nothing moves before :meth:`results`.

        Args:
            session: session with the device.
            person: person beside the robot.
            model: robot model; its nominal battery voltage is checked.
            clear_stop: clear a latched safety stop before the first duty.

        """
        self._session, self._person, self._model = session, person, model
        self._clear_stop = clear_stop

    def results(self) -> Iterator[CheckResult]:
        """Run the checks in order. Yield their results, and stop after a check that is not passed.

        Raises:
            DeviceLostError: the device was lost.
            CommandRejectedError: the device rejected a command.
            StoppedForSafetyError: a stop was already latched.
            InterruptedByPersonError: the person interrupted the procedure.

        """
        for check in (
            self._before,
            self._board,
            self._encoders_by_hand,
            self._supply_on,
            self._stages,
            self._stop,
            self._timeout,
        ):
            for result in check():
                yield result
                if not result.ok:
                    return

    # ---- without the motors' supply -------------------------------------------------------

    def _before(self) -> Iterator[CheckResult]:
        for name, question, advice in _BEFORE:
            confirmed = self._person.confirm(question)
            yield good(name, "confirmed") if confirmed else left_out(name, "not confirmed", advice)

    def _board(self) -> Iterator[CheckResult]:
        status = self._session.await_newest(Status)
        ignored = Fault.LIFTED | Fault.BATTERY_LOW
        faults = fault_labels(status.faults & ~int(ignored))
        if faults:
            yield wrong("device", f"reports {', '.join(faults)}", "see its log lines above")
        else:
            yield good("device", "reports no fault")

    def _encoders_by_hand(self) -> Iterator[CheckResult]:
        for wheel in (LEFT, RIGHT):
            text = f"Turn the {wheel.upper()} wheel FORWARDS by hand, by half a turn. Ready?"
            if not self._person.confirm(text):
                yield left_out(f"encoder {wheel}", "not turned")
                return
            yield from judge_encoder(self._turn_by_hand(wheel))

    def _turn_by_hand(self, wheel: str) -> Kick:
        session = self._session
        before = session.await_newest(Encoders)
        kept = session.watch(Encoders)
        session.run(HAND_S, lambda: max(map(abs, turned(before, kept))) >= MIN_COUNTS)
        session.run(REST_S)
        session.unwatch(kept)
        return Kick(wheel, wheel, True, *turned(before, kept))  # noqa: FBT003 - a named tuple

    def _supply_on(self) -> Iterator[CheckResult]:
        text = (
            "Switch the motor driver's supply ON; if it is a bench supply, limit its current to "
            "1 A. Keep a hand at its switch from now on. Is it on?"
        )
        before = self._session.await_newest(Encoders)
        kept = self._session.watch(Encoders)
        if not self._person.confirm(text):
            yield left_out("motor supply", "not switched on")
            return
        self._session.newest.pop(Power, None)
        self._session.run(REST_S)
        self._session.unwatch(kept)
        power = self._session.await_newest(Power)
        currents = power.motor_left_a, power.motor_right_a
        yield from judge_power(power.battery_v, power.logic_v, currents, self._model.battery_v)
        if max(map(abs, turned(before, kept))) >= MIN_COUNTS:
            advice = "SWITCH THE SUPPLY OFF; check the enable inputs and their pull-down resistors"
            yield wrong("motors off", "a wheel turns without a command", advice)
        else:
            yield good("motors off", "no wheel turns without a command")

    # ---- with the motors' supply ----------------------------------------------------------

    def _stages(self) -> Iterator[CheckResult]:
        for duty in STAGES:
            share = f"{100 * duty:.0f} %"
            if not self._person.confirm(f"Each wheel turns at a duty of {share}. Ready?"):
                yield left_out(f"stage {share}", "declined")
                return
            for output in (LEFT, RIGHT):
                step = f"stage {share} {output}"
                yield self._guarded(step, partial(self._stage, step, output, duty))

    def _stage(self, step: str, output: str, duty: float) -> CheckResult:
        """Turn one wheel forwards and backwards, and evaluate both."""
        self._session.enable(Mode.BRINGUP, clear_stop=self._clear_stop)
        forwards, ahead_a = self._turn(output, duty)
        backwards, astern_a = self._turn(output, -duty)
        return judge_stage(
            step,
            output,
            (forwards, backwards),
            max(ahead_a, astern_a),
            must_turn=duty == STAGES[-1],
        )

    def _turn(self, output: str, duty: float) -> tuple[Counts, float]:
        """Return both wheels' counts during one duty, and the largest current of a motor, A."""
        session = self._session
        before = session.await_newest(Encoders)
        kept = session.watch(Encoders, Power)
        session.duties(*((duty, 0.0) if output == LEFT else (0.0, duty)))
        session.run(STAGE_S)
        session.duties(0.0, 0.0)
        session.run(REST_S)
        session.unwatch(kept)
        currents = (max(m.motor_left_a, m.motor_right_a) for _, m in kept if isinstance(m, Power))
        return turned(before, kept), max(currents, default=0.0)

    def _stop(self) -> Iterator[CheckResult]:
        text = f"Both wheels turn at {100 * STAGES[-1]:.0f} %; then the program sends STOP. Ready?"
        yield self._halts("stop", text, self._session.stop)

    def _timeout(self) -> Iterator[CheckResult]:
        text = (
            f"Both wheels turn at {100 * STAGES[-1]:.0f} %; then the program sends no more duties. "
            "Ready?"
        )
        yield self._halts("command timeout", text, self._session.stop_sending)

    def _halts(self, step: str, text: str, end: Callable[[], None]) -> CheckResult:
        if not self._person.confirm(text):
            return left_out(step, "declined")
        return self._guarded(step, partial(self._halt_time, step, end))

    def _halt_time(self, step: str, end: Callable[[], None]) -> CheckResult:
        """Turn both wheels, end the motion with ``end``, and measure the time to standstill."""
        session = self._session
        session.enable(Mode.BRINGUP, clear_stop=self._clear_stop)
        session.duties(STAGES[-1], STAGES[-1])
        session.run(STAGE_S)
        kept = session.watch(Encoders)
        end()
        session.run(2 * STANDS_S)
        session.unwatch(kept)
        took_s = last_change_s(kept)
        if took_s > STANDS_S:
            advice = "SWITCH THE SUPPLY OFF; check the enable inputs of the motor driver"
            return wrong(step, f"a wheel still turned after {took_s:.1f} s", advice)
        return good(step, f"both wheels stood after {took_s:.2f} s")

    def _guarded(self, step: str, check: Callable[[], CheckResult]) -> CheckResult:
        """Run a check with motion; stop the wheels afterwards, also after an error."""
        try:
            return check()
        except InterruptedByPersonError:
            raise
        except StoppedForSafetyError as error:
            return wrong(step, str(error), "see the device's log lines above")
        finally:
            self._session.stop()
