"""Reaching a session that lives in another thread's loop."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Protocol, TypeVar

from bridge.errors import DeviceLostError
from bridge.io import clock

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import Future

    from bridge.run.commands import Dialogue
    from bridge.run.host import Host
    from bridge.session.session import Session
    from protocol.clock import HostNs
    from protocol.messages import Status

WAIT_S = 8.0
"""Six tries with the timeout doubling, and a flash that erases: only a dead loop is longer."""
_HANGS = "the loop that has its port does not answer"
R = TypeVar("R")


class InLoop(Protocol):
    """What runs something in a loop's own thread."""

    def __call__(self, action: Callable[[], R]) -> Future[R]:
        """Have it run at the loop's next turn; what it gives or raises is the answer's."""


class LoopExchange:
    """A host's session, for any thread but the loop's."""

    def __init__(self, host: Host, call: InLoop) -> None:
        """``call`` runs something in the loop's own thread, as :meth:`Pump.call` does."""
        self._host = host
        self._call = call

    @property
    def session(self) -> Session:
        """The session; to be touched in the loop only."""
        return self._host.session

    @property
    def commands(self) -> Dialogue:
        """The session's commands under way; only what it replaces as a whole is read elsewhere."""
        return self._host.commands

    @property
    def status(self) -> Status | None:
        """The device's newest status."""
        return self._host.state.status

    def now(self) -> HostNs:
        """The host's clock."""
        return clock.now()

    def call(self, action: Callable[[], R]) -> R:
        """Run something in the loop; gives its result.

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

    def wait(self, begin: Callable[[Callable[[], None]], None], what: str) -> None:
        """Run ``begin`` in the loop, and wait until it has called its argument.

        Raises:
            DeviceLostError: it was not called in time.

        """
        answered = threading.Event()
        self.call(lambda: begin(answered.set))
        if not answered.wait(WAIT_S):
            raise DeviceLostError(f"no answer to {what}: {_HANGS}")
