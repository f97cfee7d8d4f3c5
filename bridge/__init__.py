"""Host side of the bridge: ``bridge.open(port)`` returns a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bridge.api.robot import Robot

__all__ = ["Robot", "open"]


def __getattr__(name: str) -> Any:  # noqa: ANN401 - the interface of a module's __getattr__
    """Import ``bridge.Robot`` on first use, so that importing the package stays fast."""
    if name == "Robot":
        from bridge.api.robot import Robot  # noqa: PLC0415 - imported on first use

        return Robot
    raise AttributeError(f"module 'bridge' has no attribute {name!r}")


def open(port: str, **options: Any) -> Robot:  # noqa: A001, ANN401 - bridge.open, like os.open; options of Robot
    """Open a robot's port and connect to the device.

    Args:
        port: Device path, ``socket://HOST:PORT``, ``rfc2217://HOST:PORT`` or
            ``can:INTERFACE:CHANNEL``.
        **options: Options of :class:`bridge.api.robot.Robot`.

    Returns:
        The connected robot, at standstill. Use it as a context manager.

    Raises:
        ArgumentError: an option has the wrong type or range.
        PortError: the port cannot be opened.
        NoDeviceError: no device answered.
        SeveralDevicesError: several devices answered, and ``node`` is missing.
        DisagreementError: the device is incompatible.

    """
    from bridge.api.robot import Robot  # noqa: PLC0415 - importing the package must stay fast

    return Robot(port, **options)
