"""Acknowledged commands to a device: each call waits for its answer.

Used by a robot that a program drives, by the socket through which other processes ask, and by the
bring-up procedures. How a call waits is the business of its :class:`Exchange`.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol, TypeVar

from bridge.errors import BridgeError, DeviceLostError, ParameterError, shown
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

    from bridge.run.commands import Dialogue
    from bridge.session.session import Session
    from protocol.clock import HostNs
    from protocol.commands import Outcome
    from protocol.messages import Status
    from protocol.schema.message import Message

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


class Exchange(Protocol):
    """Where commands are sent, and how to wait for what becomes of them."""

    @property
    def session(self) -> Session:
        """The session with the device."""

    @property
    def commands(self) -> Dialogue:
        """The session's commands under way."""

    @property
    def status(self) -> Status | None:
        """The device's newest status."""

    def now(self) -> HostNs:
        """Host time."""

    def call(self, action: Callable[[], R]) -> R:
        """Run something where the session lives; gives its result.

        Raises:
            DeviceLostError: what serves the session has ended, or hangs.
            Exception: what the action raised.

        """

    def wait(self, begin: Callable[[Callable[[], None]], None], what: str) -> None:
        """Run ``begin`` where the session lives, and wait until it has called its argument.

        Raises:
            DeviceLostError: it was not called in time; ``what`` names the command.

        """


class DeviceClient:
    """Sends acknowledged commands and waits for how they end."""

    def __init__(self, exchange: Exchange) -> None:
        """``exchange`` reaches the session."""
        self._exchange = exchange

    # ---- commands -------------------------------------------------------------------------

    def command(self, kind: type[Message], *fields: int, what: str | None = None) -> None:
        """Send one command and wait; ``what`` names it in errors.

        Raises:
            ParameterError: a value does not fit its field; nothing was sent.
            CommandRejectedError: the device refused; the text has its reason.
            DeviceLostError: it did not answer, or is not there.

        """
        name = what or _NAMES.get(kind, kind.__name__)
        check_fields(name, kind, fields)
        exchange = self._exchange
        answers: list[Outcome | None] = []

        def begin(done: Callable[[], None]) -> None:
            def ended(outcome: Outcome | None) -> None:
                answers.append(outcome)
                done()

            check_known(name, kind, exchange.session.link)
            exchange.commands.ask(kind, fields, exchange.now(), ended)

        with noted(None if kind is GetParameter else name):
            exchange.wait(begin, name)
        check_outcome(name, answers[0])

    # ---- parameters -----------------------------------------------------------------------

    def list_parameters(self) -> list[Parameter]:
        """Ask for every parameter; by number.

        Raises:
            CommandRejectedError: the device has none.
            DeviceLostError: it did not answer.

        """
        first = self._fetch([0])
        count = self._exchange.call(lambda: self._exchange.commands.parameter_count) or 0
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
        names = {p.name: n for n, p in self._exchange.commands.parameters.items()}
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
        exchange, name = self._exchange, _NAMES[GetParameter]
        answers: list[tuple[Outcome | None, Parameter | None]] = []

        def begin(done: Callable[[], None]) -> None:
            def ended(outcome: Outcome | None, parameter: Parameter | None) -> None:
                answers.append((outcome, parameter))
                if len(answers) == len(numbers):
                    done()

            check_known(name, GetParameter, exchange.session.link)
            for number in numbers:
                exchange.commands.fetch(number, exchange.now(), ended)

        exchange.wait(begin, name)
        for outcome, _ in answers:
            check_outcome(name, outcome)
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
        status = self._exchange.call(lambda: self._exchange.status)
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
