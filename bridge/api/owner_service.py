"""A port's owner, and how other processes reach the robot through it.

A session owns its port. What another shell wants of the robot (stop it, read or set a
parameter, look on) goes through the owner's socket; where nobody owns the port, it is opened::

    with reach("/dev/ttyUSB0") as robot:
        print(robot.get_parameter("wheel_diameter").value)

"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, Self

from bridge.api.client import Asker
from bridge.errors import BridgeError, NoOwnerError, OwnerRefusedError, shown
from bridge.io import clock
from bridge.io.owner_client import ask, has_owner, watch
from bridge.run.ending import Ending
from bridge.run.snapshot import snapshot
from bridge.session.parameters import Parameter
from protocol.values import StopCause

if TYPE_CHECKING:
    from types import TracebackType

    from bridge.api.pump import Pump
    from bridge.run.host import Host

__all__ = ["OwnerService", "Reached", "RemoteRobot", "ask", "has_owner", "reach", "watch"]

CONFIRM_S = 3.0
"""For a stop: longer than the run itself waits for the device's word."""


class Reached(Protocol):
    """What both a robot of our own and one that another process owns can be asked for."""

    def list_parameters(self) -> list[Parameter]:
        """Every parameter, by number."""

    def get_parameter(self, name: str | int) -> Parameter:
        """One, by name or number."""

    def set_parameter(self, name: str | int, value: float | str) -> Parameter:
        """Change one until the next boot; gives what the device has then."""

    def save_parameters(self) -> None:
        """Make the present values the next boot's."""

    def stream_rate(self, stream: str, rate_hz: float) -> None:
        """Have a stream sent this often until the session ends; 0: not at all."""

    def reboot(self, *, factory_reset: bool = False) -> None:
        """Have the device boot anew."""

    def snapshot(self) -> dict[str, Any]:
        """What is known of the robot now, for JSON."""

    def stop(self) -> None:
        """Stop and latch, cause ``operator``; raises where the device does not confirm it."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


def reach(port: str, **options: Any) -> Reached:  # noqa: ANN401 - options of Robot
    """Reach the robot on a port: through its owner, or by opening the port.

    ``options`` are those of :class:`bridge.api.robot.Robot`, for the port that nobody owns.

    Raises:
        PortError: the port cannot be opened; another user's process has it, for one.
        NoDeviceError: no sweeper answered.

    """
    from bridge.api.robot import Robot  # noqa: PLC0415 - an owner's socket is reached without it

    return RemoteRobot(port) if has_owner(port) else Robot(port, **options)


class RemoteRobot:
    """A robot whose port another process owns; each call is one question to that process.

    Every method raises :class:`NoOwnerError` where that process has ended, and
    :class:`OwnerRefusedError` where it or the device refuses.
    """

    def __init__(self, port: str) -> None:
        self._port = port

    def list_parameters(self) -> list[Parameter]:
        """Every parameter, by number."""
        return [Parameter.from_dict(p) for p in self._ask("list")["parameters"]]

    def get_parameter(self, name: str | int) -> Parameter:
        """One, by name or number."""
        return Parameter.from_dict(self._ask("get", name=name)["parameter"])

    def set_parameter(self, name: str | int, value: float | str) -> Parameter:
        """Change one until the next boot; gives what the device has then."""
        return Parameter.from_dict(self._ask("set", name=name, value=value)["parameter"])

    def save_parameters(self) -> None:
        """Make the present values the next boot's."""
        self._ask("save")

    def stream_rate(self, stream: str, rate_hz: float) -> None:
        """Have a stream sent this often until the session ends; 0: not at all."""
        self._ask("rate", stream=stream, hz=rate_hz)

    def reboot(self, *, factory_reset: bool = False) -> None:
        """Have the device boot anew."""
        self._ask("reboot", factory_reset=factory_reset)

    def snapshot(self) -> dict[str, Any]:
        """What is known of the robot now, for JSON."""
        status = self._ask("status")["status"]
        return status if isinstance(status, dict) else {}

    def stop(self) -> None:
        """Stop and latch, cause ``operator``; the owner's run ends.

        Returns once the device has confirmed the stop; raises :class:`OwnerRefusedError` where it
        did not.
        """
        answer = self._ask("stop")
        if answer.get("confirmed") is not True:
            reason = str(answer.get("ending", "no reason is given"))
            raise OwnerRefusedError(f"the device did not confirm the stop: {reason}", 3)

    def _ask(self, what: str, **fields: str | float | bool) -> dict[str, Any]:
        return ask(self._port, {"do": what, **fields})

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Nothing to give back."""


class OwnerService:
    """What an owner answers on its socket; see docs/owner-socket.md."""

    def __init__(self, host: Host, pump: Pump) -> None:
        self._host = host
        self._pump = pump
        self._asker = Asker(host, pump.call)

    @property
    def over(self) -> bool:
        """True when the run is done."""
        return self._pump.result is not None

    def snapshot(self) -> dict[str, Any]:
        """What is known of the robot now."""
        return snapshot(self._pump.snapshot, clock.now() / 1e9)

    def answer(self, request: dict[str, Any], asker: str) -> dict[str, Any]:
        """Do what a request asks for.

        Raises:
            BridgeError: it cannot be done, or is no request.

        """
        what, ours = request.get("do"), self._asker
        match what:
            case "stop":
                return self._stop(asker)
            case "resume":
                self._resume()
            case "save":
                ours.save_parameters()
            case "rate":
                ours.stream_rate(str(request.get("stream")), _number(request, "hz"))
            case "reboot":
                ours.reboot(factory_reset=request.get("factory_reset") is True)
            case _:
                return self._told(what, request)
        return {}

    def _told(self, what: object, request: dict[str, Any]) -> dict[str, Any]:
        ours = self._asker
        match what:
            case "status":
                return {"status": self.snapshot()}
            case "list":
                return {"parameters": [p.to_dict() for p in ours.list_parameters()]}
            case "get":
                return {"parameter": ours.get_parameter(_name(request)).to_dict()}
            case "set":
                return {"parameter": self._set(request).to_dict()}
            case _:
                raise BridgeError(f"{shown(what)} is no request")

    def _resume(self) -> None:
        """Go on after a loss or a pause, in the loop's thread."""
        answer = self._pump.call(lambda: self._host.go_on(clock.now()))
        try:
            goes_on = answer.result(CONFIRM_S)
        except TimeoutError:
            answer.cancel()  # a person who got no answer is not surprised by a robot that moves
            raise NoOwnerError("the run does not answer") from None
        if not goes_on:
            raise BridgeError("nothing waits to go on")

    def _set(self, request: dict[str, Any]) -> Parameter:
        value = request.get("value")
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise BridgeError("set needs a value, a number or a text")
        return self._asker.set_parameter(_name(request), value)

    def _stop(self, asker: str) -> dict[str, Any]:
        reason = f"stopped from another shell ({asker})"
        ending = Ending("stopped", reason, 5, StopCause.OPERATOR)
        self._pump.request_end(ending)
        result = self._pump.wait_over(CONFIRM_S)
        if result is None:
            raise NoOwnerError("the run did not end in time; stop the robot by hand")
        confirmed = result.confirmed >= ending.cause
        return {"confirmed": confirmed, "ending": result.ending.reason}


def _name(request: dict[str, Any]) -> str | int:
    name = request.get("name")
    if isinstance(name, bool) or not isinstance(name, str | int):
        raise BridgeError("a parameter's name is a text, its number an integer")
    return name


def _number(request: dict[str, Any], key: str) -> float:
    value = request.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise BridgeError(f"{key} is not a number")
    try:
        return float(value)
    except OverflowError:
        raise BridgeError(f"{key}: {shown(value)} is too large") from None
