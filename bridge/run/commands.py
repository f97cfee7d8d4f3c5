"""Commands whose caller waits for the outcome, and the device's reported parameters.

:mod:`bridge.run.mission` requests motion. All other commands to a device pass through this module,
each with the callback that receives its outcome.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

from bridge.session.parameters import Parameter
from bridge.session.states import State
from protocol.errors import ProtocolError
from protocol.messages.host import GetParameter, PlannerCommand

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from bridge.run.mission import Request
    from bridge.session.session import Session
    from protocol.clock import HostNs
    from protocol.messages.device import ParameterValue
    from protocol.retransmission import Command, Outcome
    from protocol.schema.message import Message


def carry_out(request: Request, session: Session, now_ns: HostNs) -> None:
    """Send a request of the run."""
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
    """A parameter request that waits for its answer."""

    number: int
    found: Parameter | None = None
    """The parameter as reported since the request."""


class Dialogue:
    """A host's open commands, without the commands of its run. Used in the loop's thread only."""

    def __init__(self, session: Session) -> None:
        self.parameters: Mapping[int, Parameter] = {}
        """Parameters by number, as last reported in this boot. The mapping is replaced, never
        changed, because other threads read it."""
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
        """Send a command with these fields after the id; ``done`` is called exactly once.

        Its argument is the outcome, or None if the device is lost or not connected.
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
        """Request one parameter; ``done`` receives the outcome and the value.

        The value is None if it does not arrive before the acknowledgement.
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
        """Handle a command's outcome. Return False if the command is not from this object."""
        done = self._waiting.pop(cast("Command", outcome.message).command_id, None)
        if done is None:
            return False
        done(outcome)
        return True

    def lost(self) -> None:
        """End all open commands after the end of the session."""
        waiting, self._waiting = self._waiting, {}
        for done in waiting.values():
            done(None)

    def forget(self) -> None:
        """Discard the parameters after a reboot."""
        self.parameters = {}
        self.parameter_count = None

    def parameter(self, message: ParameterValue, *_: Any) -> None:  # noqa: ANN401 - unused device and host times
        """Store a reported parameter."""
        if message.name is not None:
            found = Parameter.from_message(message)
            self.parameter_count = message.parameter_count
            self.parameters = {**self.parameters, message.parameter: found}
            for fetching in self._fetching:
                if fetching.number == message.parameter:
                    fetching.found = found
