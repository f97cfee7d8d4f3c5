"""Access to a robot from any process: through its port's owner, or by opening the port.

A process that opens a port owns it. Other processes send their requests (stop, read or set a
parameter, show the state) to the owner's socket. A port without an owner is opened::

    with reach("/dev/ttyUSB0") as robot:
        print(robot.get_parameter("wheel_diameter").value)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, Self

from bridge.api import arguments
from bridge.errors import OwnerRejectedError
from bridge.io.owner_client import ask, has_owner
from bridge.io.ports import DEFAULT_BAUD
from bridge.run.client import noted
from bridge.session.parameters import Parameter

if TYPE_CHECKING:
    from types import TracebackType


class ReachableRobot(Protocol):
    """Operations of a robot, both in this process and in another process."""

    def list_parameters(self) -> list[Parameter]:
        """Read all parameters, sorted by number."""

    def get_parameter(self, name: str | int) -> Parameter:
        """Read one parameter by name or number."""

    def set_parameter(self, name: str | int, value: float | str) -> Parameter:
        """Set a parameter until the next boot; return it as the device reports it."""

    def save_parameters(self) -> None:
        """Save the current values, so that they survive a reboot."""

    def stream_rate(self, stream: str, rate_hz: float) -> None:
        """Set the rate of a stream until the session ends, Hz; 0: off."""

    def reboot(self, *, factory_reset: bool = False) -> None:
        """Reboot the device."""

    def snapshot(self) -> dict[str, Any]:
        """Return the robot's current state for JSON."""

    def stop(self) -> None:
        """Stop and latch with cause ``operator``; fail if the device does not confirm it."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


def reach(  # noqa: PLR0913 - the options of a port
    port: str,
    *,
    node: int | None = None,
    baud: int = DEFAULT_BAUD,
    dtr: bool = False,
    rts: bool = False,
    bitrate: int | None = None,
    lan: bool = False,
    key: bytes | None = None,
) -> ReachableRobot:
    """Connect to the robot on a port: through its owner, or by opening the port.

    The options are the same as in :func:`bridge.open`. They apply to a port without an owner,
    except ``node``: the owner rejects requests for another node than that of its session.

    Raises:
        PortError: the port cannot be opened, for example because another user's process has it.
        NoDeviceError: no device answered.

    """
    if has_owner(port):
        return RemoteRobot(port, node)
    from bridge.api.robot import Robot  # noqa: PLC0415 - not needed for an owner's socket

    return Robot(port, node=node, baud=baud, dtr=dtr, rts=rts, bitrate=bitrate, lan=lan, key=key)


class RemoteRobot:
    """A robot whose port belongs to another process; each call is one request to that process.

    Every method raises :class:`NoOwnerError` if that process has ended. It raises
    :class:`OwnerRejectedError` if that process or the device rejects the request.
    """

    def __init__(self, port: str, node: int | None = None) -> None:
        """Send requests to the owner of a port; it rejects them if its robot has another node."""
        self._port = port
        self._address = {} if node is None else {"node": node}

    def list_parameters(self) -> list[Parameter]:
        """Read all parameters, sorted by number."""
        return [Parameter.from_dict(p) for p in self._ask("list")["parameters"]]

    @arguments.checked(name=arguments.PARAMETER)
    def get_parameter(self, name: str | int) -> Parameter:
        """Read one parameter by name or number."""
        return Parameter.from_dict(self._ask("get", name=name)["parameter"])

    @arguments.checked(name=arguments.PARAMETER, value=arguments.VALUE)
    def set_parameter(self, name: str | int, value: float | str) -> Parameter:
        """Set a parameter until the next boot; return it as the device reports it."""
        return Parameter.from_dict(self._change("set", name=name, value=value)["parameter"])

    def save_parameters(self) -> None:
        """Save the current values, so that they survive a reboot."""
        self._change("save")

    @arguments.checked(stream=arguments.TEXT, rate_hz=arguments.HERTZ)
    def stream_rate(self, stream: str, rate_hz: float) -> None:
        """Set the rate of a stream until the session ends, Hz; 0: off."""
        self._change("rate", stream=stream, hz=rate_hz)

    @arguments.checked(factory_reset=arguments.FLAG)
    def reboot(self, *, factory_reset: bool = False) -> None:
        """Reboot the device; ``factory_reset`` deletes its saved parameters."""
        self._change("reboot", factory_reset=factory_reset)

    def snapshot(self) -> dict[str, Any]:
        """Return the robot's current state for JSON."""
        status = self._ask("status")["status"]
        return status if isinstance(status, dict) else {}

    def stop(self) -> None:
        """Stop and latch with cause ``operator``; the owner's run ends.

        Returns after the device has confirmed the stop.

        Raises:
            OwnerRejectedError: the device did not confirm the stop.

        """
        answer = self._ask("stop")
        if answer.get("confirmed") is not True:
            reason = str(answer.get("ending", "no reason given"))
            raise OwnerRejectedError(f"the device did not confirm the stop: {reason}", 3)

    def _change(self, what: str, **fields: str | float | bool) -> dict[str, Any]:
        with noted(f"{what} (sent to the owner of the port)"):
            return self._ask(what, **fields)

    def _ask(self, what: str, **fields: str | float | bool) -> dict[str, Any]:
        return ask(self._port, {"do": what, **self._address, **fields})

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Do nothing: each request has its own connection."""
