"""Access to a session from threads other than its loop's thread."""

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
    from protocol.messages.device import Status

WAIT_S = 8.0
"""Maximum wait for an answer, s. It is longer than six attempts with doubled timeouts and a flash
erase."""
_HANGS = "the loop of its port does not respond"
R = TypeVar("R")


class InLoop(Protocol):
    """A function that runs an action in the loop's thread."""

    def __call__(self, action: Callable[[], R]) -> Future[R]:
        """Run ``action`` in the loop's next pass; the future gets its result or exception."""


class LoopExchange:
    """Access to a host's session, for every thread except the loop's."""

    def __init__(self, host: Host, call: InLoop) -> None:
        """Create the access.

        ``call`` runs an action in the loop's thread, as :meth:`Pump.call` does.
        """
        self._host = host
        self._call = call

    @property
    def session(self) -> Session:
        """The session; use it in the loop's thread only."""
        return self._host.session

    @property
    def commands(self) -> Dialogue:
        """The commands that wait for an answer. Other threads may read only its mappings."""
        return self._host.commands

    @property
    def status(self) -> Status | None:
        """The device's newest status."""
        return self._host.state.status

    def now(self) -> HostNs:
        """The host's clock."""
        return clock.now()

    def call(self, action: Callable[[], R]) -> R:
        """Run ``action`` in the loop's thread and return its result.

        Raises:
            DeviceLostError: the loop has ended or does not respond.
            Exception: any exception of ``action``.

        """
        answer = self._call(action)
        try:
            return answer.result(WAIT_S)
        except TimeoutError:
            answer.cancel()  # it must not run late
            raise DeviceLostError(_HANGS) from None

    def wait(self, begin: Callable[[Callable[[], None]], None], what: str) -> None:
        """Run ``begin`` in the loop's thread and wait until it calls its argument.

        Raises:
            DeviceLostError: no call in time.

        """
        answered = threading.Event()
        self.call(lambda: begin(answered.set))
        if not answered.wait(WAIT_S):
            raise DeviceLostError(f"no answer to {what}: {_HANGS}")
