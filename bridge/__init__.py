"""Host side of the bridge: ``bridge.open(port)`` returns a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bridge.api.robot import Robot
    from bridge.motion.robot_model import RobotModel
    from bridge.record.sink import Sink

__all__ = ["Robot", "open"]


def __getattr__(name: str) -> Any:  # noqa: ANN401 - the interface of a module's __getattr__
    """Import ``bridge.Robot`` on first use, so that importing the package stays fast."""
    if name == "Robot":
        from bridge.api.robot import Robot  # noqa: PLC0415 - imported on first use

        return Robot
    raise AttributeError(f"module 'bridge' has no attribute {name!r}")


def open(  # noqa: A001, PLR0913 - bridge.open, like os.open; the options of a port
    port: str,
    *,
    model: RobotModel | None = None,
    sink: Sink | None = None,
    node: int | None = None,
    baud: int = 921_600,
    dtr: bool = False,
    rts: bool = False,
    bitrate: int | None = None,
    lan: bool = False,
    key: bytes | None = None,
    timeout_s: float = 5.0,
) -> Robot:
    """Open a robot's port and connect to the device.

    Args:
        port: Device path, ``socket://HOST:PORT``, ``rfc2217://HOST:PORT`` or
            ``can:INTERFACE:CHANNEL``.
        model: Dimensions and limits of the robot; None: the default robot.
        sink: Receives every record of the session.
        node: Node of the device, 1 to 15; needed if a bus has several devices.
        baud: Baud rate of a serial port.
        dtr: Activate DTR. Off by default, because many boards reset on it.
        rts: Activate RTS. Also off by default.
        bitrate: Bit rate of a CAN bus, bit/s; None: the adapter's default.
        lan: Allow a virtual bus that other machines on the network can reach.
        key: 16-byte key that signs motion commands if the device requires it.
        timeout_s: Maximum wait for the device, s.

    Returns:
        The connected robot, at standstill. Use it as a context manager.

    Raises:
        ArgumentError: an option has the wrong type or range.
        PortError: the port cannot be opened.
        NoDeviceError: no device answered.
        SeveralDevicesError: several devices answered, and ``node`` is missing.
        IncompatibleError: the device is incompatible.

    """
    from bridge.api.robot import Robot  # noqa: PLC0415 - importing the package must stay fast

    return Robot(
        port,
        model=model,
        sink=sink,
        node=node,
        baud=baud,
        dtr=dtr,
        rts=rts,
        bitrate=bitrate,
        lan=lan,
        key=key,
        timeout_s=timeout_s,
    )
