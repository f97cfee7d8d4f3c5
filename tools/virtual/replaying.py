"""A recorded robot served on a pseudo-terminal."""

from __future__ import annotations

import select
from typing import TYPE_CHECKING

from bridge.io import clock

if TYPE_CHECKING:
    from bridge.replay.device import ReplayDevice
    from sim_device.ports.base import DevicePort, Stopper

_IDLE_S = 0.1
"""Maximum interval between checks of the stopper and the clock, s."""


def serve(device: ReplayDevice, port: DevicePort, stopper: Stopper) -> None:
    """Serve the device on the port in real time, until stopped."""
    while not stopper.stopped:
        wait_s = min(_IDLE_S, max(0.0, (device.next_deadline() - clock.now()) / 1e9))
        ready, _, _ = select.select([stopper.fileno(), *port.filenos()], [], [], wait_s)
        data = port.read() if not set(port.filenos()).isdisjoint(ready) else b""
        now_ns = clock.now()
        if data:
            device.receive(data, now_ns)
        device.poll(now_ns)
        # Bytes without a reader are dropped, as on a serial line without a receiver.
        waiting = device.data_to_send()
        if waiting:
            port.write(waiting)
