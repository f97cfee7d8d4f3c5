"""Acknowledged commands to a device; each call waits for its answer.

The Python API, the owner's socket and the bring-up procedures use this module. An :class:`Exchange`
defines how a call waits.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol, TypeVar

from bridge.errors import BridgeError, DeviceLostError, ParameterError, shown
from bridge.run.rejections import check_fields, check_known, check_outcome
from bridge.session.parameters import Parameter, closest
from protocol.messages.host import (
    ClearStop,
    GetParameter,
    PlannerCommand,
    Reboot,
    SaveParameters,
    SetKey,
    SetParameter,
    SetStreamRate,
)
from protocol.messages.values import (
    OnboardPlanner,
    ParameterKind,
    PlannerAction,
    RebootKind,
    StopCause,
    latched_cause,
)
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction, RateClass

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from bridge.run.commands import Dialogue
    from bridge.session.session import Session
    from protocol.clock import HostNs
    from protocol.messages.device import Status
    from protocol.retransmission import Outcome
    from protocol.schema.message import Message

AT_ONCE = 8
"""Maximum number of open parameter requests. It is half of the number of replies that a device
stores."""
_TRIES = 3
"""Number of requests for a parameter. Its value may be lost although its acknowledgement
arrives."""
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
    """On Ctrl-C, add the note that the result of command ``what`` is unknown; None: no note."""
    try:
        yield
    except KeyboardInterrupt as error:
        if what is not None:
            error.add_note(f"{what}: no answer received; the device may have executed it")
        raise


class Exchange(Protocol):
    """Access to the session: where commands are sent, and how a call waits for the outcome."""

    @property
    def session(self) -> Session:
        """The session with the device."""

    @property
    def commands(self) -> Dialogue:
        """The commands that wait for an answer."""

    @property
    def status(self) -> Status | None:
        """The device's newest status."""

    def now(self) -> HostNs:
        """Host time."""

    def call(self, action: Callable[[], R]) -> R:
        """Run ``action`` in the session's thread and return its result.

        Raises:
            DeviceLostError: the session's thread has ended or does not respond.
            Exception: any exception of ``action``.

        """

    def wait(self, begin: Callable[[Callable[[], None]], None], what: str) -> None:
        """Run ``begin`` in the session's thread and wait until it calls its argument.

        Raises:
            DeviceLostError: the argument was not called in time; the text names the command
                ``what``.

        """


class DeviceClient:
    """Sends acknowledged commands and waits for their outcomes."""

    def __init__(self, exchange: Exchange) -> None:
        """Use ``exchange`` to reach the session."""
        self._exchange = exchange

    # ---- commands -------------------------------------------------------------------------

    def command(self, kind: type[Message], *fields: int, what: str | None = None) -> None:
        """Send one command and wait for its outcome.

        Args:
            kind: Message class of the command.
            *fields: Its raw fields after the command id.
            what: Name of the command in errors.

        Raises:
            ParameterError: a value does not fit its field; nothing was sent.
            CommandRejectedError: the device rejected the command; the text has the reason.
            DeviceLostError: no answer, or no device.

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
        check_outcome(name, answers[0], self._signs)

    def _signs(self) -> bool:
        return self._exchange.call(lambda: self._exchange.session.signs)

    # ---- parameters -----------------------------------------------------------------------

    def list_parameters(self) -> list[Parameter]:
        """Read all parameters, sorted by number.

        Raises:
            CommandRejectedError: the device has no parameters.
            DeviceLostError: the device did not answer.

        """
        first = self._fetch([0])
        count = self._exchange.call(lambda: self._exchange.commands.parameter_count) or 0
        found = {**first, **self._fetch(range(1, count))}
        return [found[number] for number in sorted(found)]

    def get_parameter(self, name: str | int) -> Parameter:
        """Read one parameter by name or number.

        Raises:
            ParameterError: unknown name, or a number outside the field's range.
            CommandRejectedError: unknown number.
            DeviceLostError: the device did not answer.

        """
        number = self._number(name)
        return self._fetch([number])[number]

    def set_parameter(self, name: str | int, value: float | str) -> Parameter:
        """Set a parameter until the next boot; return it as the device reports it.

        Args:
            name: Name or number.
            value: New value in the parameter's unit.

        Raises:
            ParameterError: unknown parameter, or a value of the wrong kind or range.
            CommandRejectedError: the device rejected the value.
            DeviceLostError: the device did not answer.

        """
        known = self.get_parameter(name)
        if known.kind.upper() not in ParameterKind.__members__:
            raise ParameterError(f"{known.name}: cannot set a value of kind {known.kind}")
        kind = ParameterKind[known.kind.upper()]
        self.command(SetParameter, known.number, kind, known.raw(value))
        return self.get_parameter(known.number)

    def save_parameters(self) -> None:
        """Save the current values, so that they survive a reboot.

        Raises:
            CommandRejectedError: the device rejected the command, for example because motion is
                enabled.
            DeviceLostError: the device did not answer.

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
        """Read these parameters; only values received after the request count."""
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
        raise DeviceLostError(f"no value for parameter {missing[0]} from the device; try again")

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
            check_outcome(name, outcome, self._signs)
        return {found.number: found for _, found in answers if found is not None}

    # ---- other commands -------------------------------------------------------------------

    def stream_rate(self, stream: str, rate_hz: float) -> None:
        """Set the rate of a stream until the session ends.

        Args:
            stream: Name of the stream's message.
            rate_hz: Rate, 0.1 to 1000 Hz; 0 switches the stream off.

        Raises:
            ParameterError: unknown stream, or a rate outside the range.
            CommandRejectedError: the device rejected the rate.
            DeviceLostError: the device did not answer.

        """
        streams = {
            s.name: s.type_id
            for s in CATALOGUE
            if s.direction is Direction.DEVICE and s.rate is RateClass.STREAM
        }
        if stream not in streams:
            raise ParameterError(f"unknown stream {shown(stream)}; use one of {', '.join(streams)}")
        if not 0.0 <= rate_hz <= 1000.0:  # noqa: PLR2004 - the range of SetStreamRate
            raise ParameterError(f"{shown(rate_hz)} Hz is not in 0 to 1000 Hz")
        tenths = round(rate_hz * 10.0)
        if rate_hz and not tenths:
            raise ParameterError(f"{shown(rate_hz)} Hz is below 0.1 Hz; 0 switches a stream off")
        self.command(SetStreamRate, streams[stream], tenths)

    def reboot(self, *, factory_reset: bool = False) -> None:
        """Reboot the device; ``factory_reset`` deletes its saved parameters and keys.

        Raises:
            CommandRejectedError: the device rejected the command, for example because motion is
                enabled.
            DeviceLostError: the device did not answer.

        """
        self.command(Reboot, RebootKind.FACTORY_RESET if factory_reset else RebootKind.NORMAL)

    def clear_stop(self) -> StopCause:
        """Clear the latched stop of any cause; return the cause.

        Raises:
            BridgeError: no status received yet.
            CommandRejectedError: the device rejected the command, for example because the cause
                persists.
            DeviceLostError: the device did not answer.

        """
        status = self._exchange.call(lambda: self._exchange.status)
        if status is None:
            raise BridgeError("no status received from the device yet; try again")
        if status.stop_cause == StopCause.NONE:
            return StopCause.NONE
        self.command(ClearStop, status.stop_cause)
        return latched_cause(StopCause.NONE, status.stop_cause)

    def planner(
        self, action: PlannerAction, planner: OnboardPlanner = OnboardPlanner.PAPER
    ) -> None:
        """Start, pause, resume or abort the device's own planner.

        Raises:
            CommandRejectedError: the device rejected the action.
            DeviceLostError: the device did not answer.

        """
        self.command(PlannerCommand, action, planner)
