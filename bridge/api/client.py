"""Asking a device from any thread but the loop's: each call waits for its answer.

Used by :class:`bridge.api.robot.Robot` and by the socket through which other processes ask
(:mod:`bridge.api.owner_service`).
"""

from __future__ import annotations

import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol, TypeVar

from bridge.errors import BridgeError, DeviceLostError, ParameterError, shown
from bridge.io import clock
from bridge.run.refusals import check_fields, check_known, check_outcome
from bridge.session.parameters import Parameter, closest
from protocol.messages import (
    ClearStop,
    GetParameter,
    PlannerCommand,
    Reboot,
    SaveParameters,
    SetKey,
    SetParameter,
    SetStreamRate,
)
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction, RateClass
from protocol.values import (
    OnboardPlanner,
    ParameterKind,
    PlannerAction,
    RebootKind,
    StopCause,
    latched_cause,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from concurrent.futures import Future

    from bridge.run.host import Host
    from protocol.commands import Outcome
    from protocol.schema.message import Message

WAIT_S = 8.0
"""Six tries with the timeout doubling, and a flash that erases: only a dead loop is longer."""
AT_ONCE = 8
"""Half of the replies that a device remembers."""
_TRIES = 3
"""A parameter's value may be lost where its acknowledgement is not."""
_NAMES = {
    GetParameter: "get parameter",
    SetParameter: "set parameter",
    SaveParameters: "save parameters",
    SetStreamRate: "set stream rate",
    Reboot: "reboot",
    ClearStop: "clear stop",
    PlannerCommand: "planner",
    SetKey: "set key",
}


_HANGS = "the loop that has its port does not answer"
R = TypeVar("R")


@contextmanager
def noted(what: str | None) -> Iterator[None]:
    """Have a Ctrl-C meanwhile say what it leaves unknown; None: nothing."""
    try:
        yield
    except KeyboardInterrupt as error:
        if what is not None:
            error.add_note(f"the device may have carried out {what}: no answer has come")
        raise


class InLoop(Protocol):
    """What runs something in a loop's own thread."""

    def __call__(self, action: Callable[[], R]) -> Future[R]:
        """Have it run at the loop's next turn; what it gives or raises is the answer's."""


class Asker:
    """Sends acknowledged commands through a running loop and waits for how they end."""

    def __init__(self, host: Host, call: InLoop) -> None:
        """``call`` runs something in the loop's own thread, as :meth:`Pump.call` does."""
        self._host = host
        self._call = call

    # ---- commands -------------------------------------------------------------------------

    def command(self, kind: type[Message], *fields: int) -> None:
        """Send one command and wait.

        Raises:
            ParameterError: a value does not fit its field; nothing was sent.
            CommandRejectedError: the device refused; the text has its reason.
            DeviceLostError: it did not answer, or is not there.

        """
        what = _NAMES.get(kind, kind.__name__)
        check_fields(what, kind, fields)
        answers: list[Outcome | None] = []
        answered = threading.Event()

        def ended(outcome: Outcome | None) -> None:
            answers.append(outcome)
            answered.set()

        def ask() -> None:
            check_known(what, kind, self._host.session.link)
            self._host.commands.ask(kind, fields, clock.now(), ended)

        with noted(None if kind is GetParameter else what):
            self._in_loop(ask)
            self._await(answered, what)
        check_outcome(what, answers[0])

    def _in_loop(self, action: Callable[[], R]) -> R:
        """Have something run in the loop and wait for what it gives.

        Raises:
            DeviceLostError: the loop has ended, or hangs.
            Exception: what the action raised.

        """
        answer = self._call(action)
        try:
            return answer.result(WAIT_S)
        except TimeoutError:
            answer.cancel()  # it must not happen late
            raise DeviceLostError(_HANGS) from None

    @staticmethod
    def _await(answered: threading.Event, what: str) -> None:
        if not answered.wait(WAIT_S):
            raise DeviceLostError(f"no answer to {what}: {_HANGS}")

    # ---- parameters -----------------------------------------------------------------------

    def list_parameters(self) -> list[Parameter]:
        """Ask for every parameter; by number.

        Raises:
            CommandRejectedError: the device has none.
            DeviceLostError: it did not answer.

        """
        first = self._fetch([0])
        count = self._in_loop(lambda: self._host.commands.parameter_count) or 0
        found = {**first, **self._fetch(range(1, count))}
        return [found[number] for number in sorted(found)]

    def get_parameter(self, name: str | int) -> Parameter:
        """Ask for one, by name or number.

        Raises:
            ParameterError: there is none of this name, or a number that no parameter can have.
            CommandRejectedError: there is none of this number.
            DeviceLostError: the device did not answer.

        """
        number = self._number(name)
        return self._fetch([number])[number]

    def set_parameter(self, name: str | int, value: float | str) -> Parameter:
        """Change one until the next boot; gives what the device has then.

        Raises:
            ParameterError: no such parameter, or it does not take the value.
            CommandRejectedError: the device refused.
            DeviceLostError: it did not answer.

        """
        known = self.get_parameter(name)
        if known.kind.upper() not in ParameterKind.__members__:
            raise ParameterError(f"{known.name}: this program cannot set a value of {known.kind}")
        kind = ParameterKind[known.kind.upper()]
        self.command(SetParameter, known.number, kind, known.raw(value))
        return self.get_parameter(known.number)

    def save_parameters(self) -> None:
        """Make the present values the next boot's.

        Raises:
            CommandRejectedError: the device refused; while it may move, for one.
            DeviceLostError: it did not answer.

        """
        self.command(SaveParameters)

    def _number(self, name: str | int) -> int:
        if isinstance(name, int):
            return name
        names = {p.name: n for n, p in self._host.commands.parameters.items()}
        if name not in names:
            names = {p.name: p.number for p in self.list_parameters()}
        if name not in names:
            raise ParameterError(closest(name, sorted(names)))
        return names[name]

    def _fetch(self, numbers: Iterable[int]) -> dict[int, Parameter]:
        """Ask for these parameters; what the device answered to this very question."""
        what, missing = _NAMES[GetParameter], list(numbers)
        for number in missing:
            check_fields(what, GetParameter, (number,))
        found: dict[int, Parameter] = {}
        for _ in range(_TRIES):
            for start in range(0, len(missing), AT_ONCE):
                found |= self._fetch_some(missing[start : start + AT_ONCE])
            missing = [number for number in missing if number not in found]
            if not missing:
                return found
        raise DeviceLostError(f"the device did not tell parameter {missing[0]}")

    def _fetch_some(self, numbers: Sequence[int]) -> dict[int, Parameter]:
        answers: list[tuple[Outcome | None, Parameter | None]] = []
        answered = threading.Event()

        def ended(outcome: Outcome | None, parameter: Parameter | None) -> None:
            answers.append((outcome, parameter))
            if len(answers) == len(numbers):
                answered.set()

        def ask() -> None:
            check_known(_NAMES[GetParameter], GetParameter, self._host.session.link)
            for number in numbers:
                self._host.commands.fetch(number, clock.now(), ended)

        self._in_loop(ask)
        self._await(answered, _NAMES[GetParameter])
        for outcome, _ in answers:
            check_outcome(_NAMES[GetParameter], outcome)
        return {found.number: found for _, found in answers if found is not None}

    # ---- the rest -------------------------------------------------------------------------

    def stream_rate(self, stream: str, rate_hz: float) -> None:
        """Have a stream sent this often until the session ends; 0: not at all.

        Raises:
            BridgeError: no stream has this name, or the wire cannot say the rate.
            CommandRejectedError: the device refused.
            DeviceLostError: it did not answer.

        """
        streams = {
            s.name: s.type_id
            for s in CATALOGUE
            if s.direction is Direction.DEVICE and s.rate is RateClass.STREAM
        }
        if stream not in streams:
            raise ParameterError(f"{shown(stream)} is no stream; there are {', '.join(streams)}")
        if not 0.0 <= rate_hz <= 1000.0:  # noqa: PLR2004 - as declared
            raise ParameterError(f"{shown(rate_hz)} Hz is not in 0 to 1000 Hz")
        tenths = round(rate_hz * 10.0)
        if rate_hz and not tenths:
            raise ParameterError(f"{shown(rate_hz)} Hz is below 0.1 Hz; 0 switches a stream off")
        self.command(SetStreamRate, streams[stream], tenths)

    def reboot(self, *, factory_reset: bool = False) -> None:
        """Have the device boot anew; ``factory_reset`` forgets what was saved.

        Raises:
            CommandRejectedError: the device refused; while it may move, for one.
            DeviceLostError: it did not answer.

        """
        self.command(Reboot, RebootKind.FACTORY_RESET if factory_reset else RebootKind.NORMAL)

    def clear_stop(self) -> StopCause:
        """Release the latched stop, whatever its cause; gives the cause.

        Raises:
            BridgeError: nothing is known of the device's status yet.
            CommandRejectedError: the device refused; what stopped it still holds, for one.
            DeviceLostError: it did not answer.

        """
        status = self._in_loop(lambda: self._host.state.status)
        if status is None:
            raise BridgeError("the device has not told its status yet")
        if status.stop_cause == StopCause.NONE:
            return StopCause.NONE
        self.command(ClearStop, status.stop_cause)
        return latched_cause(StopCause.NONE, status.stop_cause)

    def planner(
        self, action: PlannerAction, planner: OnboardPlanner = OnboardPlanner.PAPER
    ) -> None:
        """Start, pause, resume or abort the device's own planner.

        Raises:
            CommandRejectedError: the device refused.
            DeviceLostError: it did not answer.

        """
        self.command(PlannerCommand, action, planner)
