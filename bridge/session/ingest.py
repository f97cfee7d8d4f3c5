"""What is received, as records: the device's moment, ours with its bound, and the message.

The one place for it: a live run, bring-up, captures of other programs and the decoding of a log's
bytes again all pass here, so that the same bytes make the same records.
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
    """Times the messages of one device."""

    def __init__(self, sync: TimeSync, unix_offset_ns: int) -> None:
        """Know the offset of Unix time, and no device yet."""
        self.sync = sync
        self.device_us = DeviceUs(0)
        """When the newest message was made, by the device's clock."""
        self.unix_offset_ns = unix_offset_ns
        """Unix time less the host's clock; one for all records of a log."""
        self._mapped: Mapped | None = None
        """The same by ours."""
        self._stamp = self._arrived_ns = -1
        """Of the newest message."""

    def take(self, received: Received, now_ns: HostNs) -> DeviceMessage:
        """Give a message's record."""
        message, frame, spec = received
        _, node, _, seq, t_us, _ = frame
        if t_us != self._stamp or now_ns != self._arrived_ns:
            # What is read at once mostly is of one moment.
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
        """Take an answered time request; False where the clock was found to have stepped."""
        received_us, replied_us = (
            self.sync.extend(ping.received_us),
            self.sync.extend(ping.replied_us),
        )
        return self.sync.exchange(ping.sent_ns, received_us, replied_us, ping.arrived_ns)

    def reset(self) -> None:
        """Begin anew: the device has booted since."""
        self.sync.reset()
        self._stamp = -1
