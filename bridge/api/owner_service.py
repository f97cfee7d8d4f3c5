"""Requests of other processes to the process that owns the port; see docs/owner-socket.md."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from bridge.api.exchange import LoopExchange
from bridge.api.owner_view import SnapshotWriter
from bridge.config import to_toml
from bridge.errors import BridgeError, NoDeviceError, NoOwnerError, shown
from bridge.io import clock
from bridge.run.client import DeviceClient
from bridge.run.ending import Ending
from bridge.run.snapshot import snapshot_to_dict
from protocol.messages.values import StopCause

if TYPE_CHECKING:
    from bridge.api.pump import Pump
    from bridge.run.host import Host
    from bridge.session.parameters import Parameter

CONFIRM_S = 3.0
"""Maximum wait for a stop, s. It is longer than the run itself waits for the confirmation."""


class RunPage(Protocol):
    """Data of a run that only its program has; the robot's state does not contain them."""

    def about(self) -> dict[str, Any]:
        """Return data about the run: port, log, viewer, planner, room, elapsed time, path."""

    def news(self) -> dict[str, Any]:
        """Return the newest events as lines, and the coverage."""


class OwnerService:
    """Executes the requests of other processes on a run."""

    def __init__(self, host: Host, pump: Pump, page: RunPage | None = None) -> None:
        """Serve requests on a run; ``page`` adds the data that only its program has."""
        self._host = host
        self._pump = pump
        self._page = page
        self._writer = SnapshotWriter()
        self._client = DeviceClient(LoopExchange(host, pump.call))

    @property
    def over(self) -> bool:
        """True if the run has ended."""
        return self._pump.result is not None

    def snapshot(self) -> dict[str, Any]:
        """Return the robot's current state for JSON."""
        return snapshot_to_dict(self._pump.snapshot, clock.now() / 1e9)

    def dashboard(self) -> dict[str, Any]:
        """Return all variable data of a dashboard, for JSON."""
        shown = {"events": [], "coverage": None} if self._page is None else self._page.news()
        return {**self._writer.write(self._pump.snapshot, clock.now() / 1e9), **shown}

    def answer(self, request: dict[str, Any], requester: str) -> dict[str, Any]:
        """Execute a request; return its answer without ``ok``.

        Raises:
            BridgeError: the request is unknown, invalid or fails.

        """
        what, ours = request.get("do"), self._client
        if what != "stop":
            self._check_node(request.get("node"))
        match what:
            case "stop":
                return self._stop(requester)
            case "resume":
                self._resume()
            case "save":
                ours.save_parameters()
            case "rate":
                ours.stream_rate(str(request.get("stream")), _number(request, "hz"))
            case "reboot":
                ours.reboot(factory_reset=request.get("factory_reset") is True)
            case _:
                return self._answer_for(what, request)
        return {}

    def _check_node(self, node: object) -> None:
        """Check that a request is not for another node than that of the session.

        Raises:
            NoDeviceError: it is for another node.

        """
        own = self._host.session.node
        if node is not None and node != own:
            has = "has no device yet" if own is None else f"is connected to node {own}"
            raise NoDeviceError(f"the port's owner {has}; the request is for node {shown(node)}")

    def _answer_for(self, what: object, request: dict[str, Any]) -> dict[str, Any]:
        ours = self._client
        match what:
            case "status":
                return {"status": self.snapshot()}
            case "about":
                about = {} if self._page is None else self._page.about()
                return {"about": {"robot": to_toml(self._host.model), **about}}
            case "list":
                return {"parameters": [p.to_dict() for p in ours.list_parameters()]}
            case "get":
                return {"parameter": ours.get_parameter(_name(request)).to_dict()}
            case "set":
                return {"parameter": self._set(request).to_dict()}
            case _:
                raise BridgeError(f"unknown request {shown(what)}")

    def _resume(self) -> None:
        """Continue a run after a loss or a pause, in the loop's thread."""
        answer = self._pump.call(lambda: self._host.resume_run(clock.now()))
        try:
            goes_on = answer.result(CONFIRM_S)
        except TimeoutError:
            answer.cancel()  # the robot must not move after this error
            raise NoOwnerError("the run does not respond") from None
        if not goes_on:
            raise BridgeError("no paused run to continue")

    def _set(self, request: dict[str, Any]) -> Parameter:
        value = request.get("value")
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise BridgeError("set: the value must be a number or a text")
        return self._client.set_parameter(_name(request), value)

    def _stop(self, requester: str) -> dict[str, Any]:
        reason = f"stopped by another process ({requester})"
        ending = Ending("stopped", reason, 5, StopCause.OPERATOR)
        node = self._host.session.node
        self._pump.request_end(ending)
        result = self._pump.wait_over(CONFIRM_S)
        if result is None:
            raise NoOwnerError("the run did not end in time; switch the robot off")
        confirmed = result.confirmed >= ending.cause
        return {"confirmed": confirmed, "ending": result.ending.reason, "node": node}


def _name(request: dict[str, Any]) -> str | int:
    name = request.get("name")
    if isinstance(name, bool) or not isinstance(name, str | int):
        raise BridgeError("a parameter's name must be a text or its number")
    return name


def _number(request: dict[str, Any], key: str) -> float:
    value = request.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise BridgeError(f"{key} is not a number")
    try:
        return float(value)
    except OverflowError:
        raise BridgeError(f"{key}: {shown(value)} is too large") from None
