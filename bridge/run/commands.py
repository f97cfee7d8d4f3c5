"""Commands that somebody waits for, and what the device told of its parameters.

The run itself (:mod:`bridge.run.mission`) asks for motion; whatever else a device can be asked for
passes here: each command with the one who wants to know how it ended.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

from bridge.session.parameters import Parameter
from bridge.session.states import State
from protocol.errors import ProtocolError
from protocol.messages import GetParameter, PlannerCommand

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from bridge.run.mission import Request
    from bridge.session.session import Session
    from protocol.clock import HostNs
    from protocol.commands import Command, Outcome
    from protocol.messages import ParameterValue
    from protocol.schema.message import Message


def carry_out(request: Request, session: Session, now_ns: HostNs) -> None:
    """Send what a run asks for."""
    match request.kind:
        case "clear":
            session.clear_stop(request.value, now_ns)
        case "mode":
            session.set_mode(request.value, now_ns)
        case "planner":
            session.command(PlannerCommand, (request.value, request.planner), now_ns)
        case _:
            session.stop(request.value, now_ns)


@dataclass(slots=True, eq=False)
class Fetch:
    """One question for a parameter that is under way."""

    number: int
    found: Parameter | None = None
    """What the device has told since the question."""


class Dialogue:
    """One host's commands under way beyond those of its run; lives in the loop's thread."""

    def __init__(self, session: Session) -> None:
        self.parameters: Mapping[int, Parameter] = {}
        """By number, as last told; of another boot they are forgotten. Replaced as a whole, never
        changed: another thread may read what it holds."""
        self.parameter_count: int | None = None
        self._session = session
        self._waiting: dict[int, Callable[[Outcome | None], None]] = {}
        self._fetching: list[Fetch] = []

    def ask(
        self,
        kind: type[Message],
        fields: tuple[int, ...],
        now_ns: HostNs,
        done: Callable[[Outcome | None], None],
    ) -> None:
        """Send a command, its fields after the id; ``done`` is called once, here or later.

        It is told how the command ended; None: the device was lost, or is not there.
        """
        if self._session.state is not State.READY:
            done(None)
            return
        self._waiting[self._session.command(kind, fields, now_ns)] = done

    def fetch(
        self,
        number: int,
        now_ns: HostNs,
        done: Callable[[Outcome | None, Parameter | None], None],
    ) -> None:
        """Ask for one parameter; ``done`` gets how the command ended, and what came for it.

        A value that does not come before the command's acknowledgement is None.
        """
        fetching = Fetch(number)
        self._fetching.append(fetching)

        def ended(outcome: Outcome | None) -> None:
            self._fetching.remove(fetching)
            done(outcome, fetching.found)

        try:
            self.ask(GetParameter, (number,), now_ns, ended)
        except ProtocolError:
            self._fetching.remove(fetching)
            raise

    def ended(self, outcome: Outcome) -> bool:
        """Take a command's outcome; False for one that was not asked here."""
        done = self._waiting.pop(cast("Command", outcome.message).command_id, None)
        if done is None:
            return False
        done(outcome)
        return True

    def lost(self) -> None:
        """The session is over: nothing is answered any more."""
        waiting, self._waiting = self._waiting, {}
        for done in waiting.values():
            done(None)

    def forget(self) -> None:
        """Another boot: parameters may have other values."""
        self.parameters = {}
        self.parameter_count = None

    def parameter(self, message: ParameterValue, *_: Any) -> None:  # noqa: ANN401 - times, of every listener
        """Take what the device told of one parameter."""
        if message.name is not None:
            found = Parameter.from_message(message)
            self.parameter_count = message.parameter_count
            self.parameters = {**self.parameters, message.parameter: found}
            for fetching in self._fetching:
                if fetching.number == message.parameter:
                    fetching.found = found
