"""All I/O of the emulator: pseudo-terminals, TCP, CAN buses, QEMU, control socket, clock.

Like a UART, a port also works without a connected host. Bytes that do not fit its buffers are
dropped and counted.
"""

from __future__ import annotations

from sim_device.ports.base import DevicePort, PortUnavailableError, Stopper
from sim_device.ports.control import ControlServer, ask_control
from sim_device.ports.multicast import MULTICAST_GROUP, MulticastPort
from sim_device.ports.pty_port import PtyPort, SlcanPort
from sim_device.ports.real_time_loop import NO_CALLBACKS, ServeCallbacks, ServeReport, serve
from sim_device.ports.tcp import TcpServerPort

__all__ = [
    "MULTICAST_GROUP",
    "NO_CALLBACKS",
    "ControlServer",
    "DevicePort",
    "MulticastPort",
    "PortUnavailableError",
    "PtyPort",
    "ServeCallbacks",
    "ServeReport",
    "SlcanPort",
    "Stopper",
    "TcpServerPort",
    "ask_control",
    "serve",
]
