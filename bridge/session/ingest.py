"""Conversion of received messages to records with device time and host time.

Live runs, bring-up, imported captures and re-decoded logs use this module. So the same bytes give
the same records everywhere.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.session.records import DeviceMessage
from protocol.clock import DeviceUs

if TYPE_CHECKING:
    from bridge.session.states import Ping
    from bridge.session.timesync import Mapped, TimeSync
    from protocol.clock import HostNs
    from protocol.link import Received

_new = tuple.__new__


class Ingest:
    """Timestamps the messages of one device."""

    def __init__(self, sync: TimeSync, unix_offset_ns: int) -> None:
        """Use ``sync`` for device time. ``unix_offset_ns`` is Unix time minus host time, ns."""
        self.sync = sync
        self.device_us = DeviceUs(0)
        """Device time of the newest message."""
        self.unix_offset_ns = unix_offset_ns
        """Unix time minus host time, ns; the same for all records of a log."""
        self._mapped: Mapped | None = None
        """Host time of the newest message."""
        self._stamp = self._arrived_ns = -1
        """Device stamp and arrival time of the newest message."""

    def take(self, received: Received, now_ns: HostNs) -> DeviceMessage:
        """Return the record of a message."""
        message, frame, spec = received
        _, node, _, seq, t_us, _ = frame
        if t_us != self._stamp or now_ns != self._arrived_ns:
            # Messages of one read usually share one stamp.
            self._stamp, self._arrived_ns = t_us, now_ns
            self.device_us, self._mapped = self.sync.observe(t_us, now_ns)
        offset_ns, mapped = self.unix_offset_ns, self._mapped
        publish_ns = bound_ns = None
        if mapped is not None:
            host_ns, bound_ns = mapped
            publish_ns = host_ns + offset_ns
        row = (now_ns + offset_ns, publish_ns, bound_ns, node, seq, t_us, spec.name, message)
        return _new(DeviceMessage, row)

    def exchange(self, ping: Ping) -> bool:
        """Handle an answered time request. Return False if the device's clock has stepped."""
        received_us, replied_us = (
            self.sync.extend(ping.received_us),
            self.sync.extend(ping.replied_us),
        )
        return self.sync.exchange(ping.sent_ns, received_us, replied_us, ping.arrived_ns)

    def reset(self) -> None:
        """Restart the time synchronisation after a reboot of the device."""
        self.sync.reset()
        self._stamp = -1
