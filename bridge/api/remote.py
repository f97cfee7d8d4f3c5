"""Reaching a robot from any process: through its port's owner, or by opening the port.

A session owns its port. What another shell wants of the robot (stop it, read or set a parameter,
look on) goes through the owner's socket; where nobody owns the port, it is opened::

    with reach("/dev/ttyUSB0") as robot:
        print(robot.get_parameter("wheel_diameter").value)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, Self

from bridge.api import arguments
from bridge.errors import OwnerRejectedError
from bridge.io.owner_client import ask, has_owner
from bridge.run.client import noted
from bridge.session.parameters import Parameter

if TYPE_CHECKING:
    from types import TracebackType


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
    if has_owner(port):
        return RemoteRobot(port)
    from bridge.api.robot import Robot  # noqa: PLC0415 - an owner's socket is reached without it

    return Robot(port, **options)


class RemoteRobot:
    """A robot whose port another process owns; each call is one question to that process.

    Every method raises :class:`NoOwnerError` where that process has ended, and
    :class:`OwnerRejectedError` where it or the device refuses.
    """

    def __init__(self, port: str) -> None:
        self._port = port

    def list_parameters(self) -> list[Parameter]:
        """Every parameter, by number."""
        return [Parameter.from_dict(p) for p in self._ask("list")["parameters"]]

    @arguments.checked(name=arguments.PARAMETER)
    def get_parameter(self, name: str | int) -> Parameter:
        """One, by name or number."""
        return Parameter.from_dict(self._ask("get", name=name)["parameter"])

    @arguments.checked(name=arguments.PARAMETER, value=arguments.VALUE)
    def set_parameter(self, name: str | int, value: float | str) -> Parameter:
        """Change one until the next boot; gives what the device has then."""
        return Parameter.from_dict(self._change("set", name=name, value=value)["parameter"])

    def save_parameters(self) -> None:
        """Make the present values the next boot's."""
        self._change("save")

    @arguments.checked(stream=arguments.TEXT, rate_hz=arguments.HERTZ)
    def stream_rate(self, stream: str, rate_hz: float) -> None:
        """Have a stream sent this often until the session ends; 0: not at all."""
        self._change("rate", stream=stream, hz=rate_hz)

    @arguments.checked(factory_reset=arguments.FLAG)
    def reboot(self, *, factory_reset: bool = False) -> None:
        """Have the device boot anew."""
        self._change("reboot", factory_reset=factory_reset)

    def snapshot(self) -> dict[str, Any]:
        """What is known of the robot now, for JSON."""
        status = self._ask("status")["status"]
        return status if isinstance(status, dict) else {}

    def stop(self) -> None:
        """Stop and latch, cause ``operator``; the owner's run ends.

        Returns once the device has confirmed the stop; raises :class:`OwnerRejectedError` where it
        did not.
        """
        answer = self._ask("stop")
        if answer.get("confirmed") is not True:
            reason = str(answer.get("ending", "no reason is given"))
            raise OwnerRejectedError(f"the device did not confirm the stop: {reason}", 3)

    def _change(self, what: str, **fields: str | float | bool) -> dict[str, Any]:
        with noted(f"{what}, which was asked of the process that has the port"):
            return self._ask(what, **fields)

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
