"""The host's end of the bridge: ``bridge.open(port)`` gives a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bridge.api.robot import Robot

__all__ = ["Robot", "open"]


def __getattr__(name: str) -> Any:  # noqa: ANN401 - the interface of a module's __getattr__
    """Give ``bridge.Robot``; importing the package stays cheap until it is asked for."""
    if name == "Robot":
        from bridge.api.robot import Robot  # noqa: PLC0415 - see above

        return Robot
    raise AttributeError(f"module 'bridge' has no attribute {name!r}")


def open(port: str, **options: Any) -> Robot:  # noqa: A001, ANN401 - bridge.open, like os.open; options of Robot
    """Open a robot's port and agree with it; options are those of :class:`bridge.api.robot.Robot`.

    Raises:
        PortError: the port cannot be opened.
        NoDeviceError: no sweeper answered.
        DisagreementError: it speaks another protocol.

    """
    from bridge.api.robot import Robot  # noqa: PLC0415 - importing the package must stay cheap

    return Robot(port, **options)
