"""Asking a device from any thread but the loop's: each call waits for its answer.

Used by :class:`bridge.robot.Robot` and by the socket through which other processes ask
(:mod:`bridge.owner`).
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from bridge.errors import BridgeError, DeviceLostError, ParameterError
from bridge.io import clock
from bridge.parameters import Parameter, closest
from bridge.refusals import check_known, check_outcome
from protocol.catalogue import CATALOGUE
from protocol.message import Direction, RateClass
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
from protocol.values import (
    OnboardPlanner,
    ParameterKind,
    PlannerAction,
    RebootKind,
    StopCause,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from bridge.host import Host
    from protocol.commands import Outcome
    from protocol.message import Message

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


class Asker:
    """Sends acknowledged commands through a running loop and waits for how they end."""

    def __init__(self, host: Host, call: Callable[[Callable[[], None]], None]) -> None:
        """``call`` runs something in the loop's own thread."""
        self._host = host
        self._call = call

    # ---- commands -------------------------------------------------------------------------

    def command(self, kind: type[Message], *fields: int) -> None:
        """Send one command and wait.

        Raises:
            CommandRejectedError: the device refused; the text has its reason.
            DeviceLostError: it did not answer, or is not there.

        """
        self._all(kind, [fields])

    def _all(self, kind: type[Message], asked: Sequence[tuple[int, ...]]) -> None:
        for start in range(0, len(asked), AT_ONCE):
            self._some(kind, asked[start : start + AT_ONCE])

    def _some(self, kind: type[Message], asked: Sequence[tuple[int, ...]]) -> None:
        what = _NAMES.get(kind, kind.__name__)
        check_known(what, kind, self._host.session.link)
        outcomes: list[Outcome | None] = []
        all_in = threading.Event()

        def ended(outcome: Outcome | None) -> None:
            outcomes.append(outcome)
            if len(outcomes) == len(asked):
                all_in.set()

        def ask() -> None:
            for fields in asked:
                self._host.dialogue.ask(kind, fields, clock.now(), ended)

        self._call(ask)
        if not all_in.wait(WAIT_S):
            raise DeviceLostError(f"no answer to {what}: the session has ended")
        for outcome in outcomes:
            check_outcome(what, outcome)

    # ---- parameters -----------------------------------------------------------------------

    def list_parameters(self) -> list[Parameter]:
        """Ask for every parameter; by number.

        Raises:
            CommandRejectedError: the device has none.
            DeviceLostError: it did not answer.

        """
        self._fetch([0])
        count = self._host.dialogue.parameter_count or 0
        self._fetch(range(1, count))
        known = self._host.dialogue.parameters
        return [known[number] for number in range(count)]

    def get_parameter(self, name: str | int) -> Parameter:
        """Ask for one, by name or number.

        Raises:
            ParameterError: there is none of this name.
            CommandRejectedError: there is none of this number.
            DeviceLostError: the device did not answer.

        """
        number = self._number(name)
        self._fetch([number])
        return self._host.dialogue.parameters[number]

    def set_parameter(self, name: str | int, value: float | str) -> Parameter:
        """Change one until the next boot; gives what the device has then.

        Raises:
            ParameterError: no such parameter, or it does not take the value.
            CommandRejectedError: the device refused.
            DeviceLostError: it did not answer.

        """
        known = self.get_parameter(name)
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
        names = {p.name: n for n, p in self._host.dialogue.parameters.items()}
        if name not in names:
            names = {p.name: p.number for p in self.list_parameters()}
        if name not in names:
            raise ParameterError(closest(name, sorted(names)))
        return names[name]

    def _fetch(self, numbers: Iterable[int]) -> None:
        known, missing = self._host.dialogue.parameters, list(numbers)
        for number in missing:
            known.pop(number, None)
        for _ in range(_TRIES):
            self._all(GetParameter, [(number,) for number in missing])
            missing = [number for number in missing if number not in known]
            if not missing:
                return
        raise DeviceLostError(f"the device did not tell parameter {missing[0]}")

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
            raise ParameterError(f"{stream!r} is no stream; there are {', '.join(streams)}")
        rate = round(rate_hz * 10.0) if 0.0 <= rate_hz <= 1000.0 else -1  # noqa: PLR2004 - as declared
        if rate < 0:
            raise ParameterError(f"{rate_hz:g} Hz is not in 0 to 1000 Hz")
        self.command(SetStreamRate, streams[stream], rate)

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
        status = self._host.state.status
        if status is None:
            raise BridgeError("the device has not told its status yet")
        cause = StopCause(status.stop_cause)
        if cause is not StopCause.NONE:
            self.command(ClearStop, cause)
        return cause

    def planner(
        self, action: PlannerAction, planner: OnboardPlanner = OnboardPlanner.PAPER
    ) -> None:
        """Start, pause, resume or abort the device's own planner.

        Raises:
            CommandRejectedError: the device refused.
            DeviceLostError: it did not answer.

        """
        self.command(PlannerCommand, action, planner)
