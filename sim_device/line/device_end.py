"""The device's end of its link: counters of the queues and of the CAN controller."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_device.device.counters import LineHealth

if TYPE_CHECKING:
    from sim_device.line.can_controller import CanController
    from sim_device.line.line import Channel


class DeviceEnd:
    """Counters since the chip's boot. Flow control prevents losses of received data."""

    def __init__(self, up: Channel, controller: CanController | None) -> None:
        """Count the data that ``up`` drops; ``controller`` is None without a CAN bus."""
        self._up, self._controller = up, controller
        self._dropped = self._offs = 0
        """Counter values at the boot."""

    def boot(self) -> None:
        """Reset the counters, because the chip's memory and controller are reset."""
        self._dropped = self._up.dropped
        if self._controller is not None:
            self._offs = self._controller.offs
            self._controller.rejoin()

    def state(self, now_us: int) -> tuple[int, int, int, bool, int]:
        """Return free space, send and receive errors, bus-off now, bus-off events since boot.

        The free space is in bytes, or in frames on a CAN bus.
        """
        room, controller = self._up.space(now_us), self._controller
        if controller is None:
            return room, 0, 0, False, 0
        errors = controller.send_errors, controller.receive_errors
        return room, *errors, controller.is_off, controller.offs - self._offs & 0xFFFF

    def health(self) -> LineHealth:
        """Return the counters."""
        dropped, controller = self._up.dropped - self._dropped, self._controller
        if controller is None:
            return LineHealth(send_dropped=dropped)
        return LineHealth(
            send_dropped=dropped,
            can_send_errors=controller.send_errors,
            can_receive_errors=controller.receive_errors,
            can_bus_offs=controller.offs - self._offs,
        )
