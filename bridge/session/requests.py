"""What a session is asked for by whoever drives: velocities, stops and modes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.session.outbox import CommandCounts, Outbox
from protocol.messages import ClearStop, SetMode, Stop

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.clock import HostNs
    from protocol.commands import CommandSender
    from protocol.link import LinkBase
    from protocol.schema.catalogue import Catalogue
    from protocol.schema.message import Message


class SessionRequests:
    """The half of a session that its user talks to; it sends, and awaits nothing."""

    def __init__(self, link: LinkBase, node: int | None, catalogue: Catalogue) -> None:
        self._outbox = Outbox(link, node)
        self._catalogue = catalogue
        self._open_stop: int | None = None
        """Gravest cause of a stop that no device has confirmed yet; it outlives a lost link."""

    @property
    def node(self) -> int | None:
        """The device's node; None until one has answered, or while any will do."""
        return self._outbox.node

    @property
    def commands(self) -> CommandSender:
        """Commands on their way."""
        return self._outbox.commands

    @property
    def command_counts(self) -> CommandCounts:
        """What became of all commands so far."""
        return self._outbox.counts

    def setpoint(self, v_m_s: float, yaw_rate_rad_s: float, ttl_ms: int, now_ns: HostNs) -> None:
        """Send a velocity; it replaces one that still waits to be written.

        What is faster than the wire can say is sent as the fastest that it can.
        """
        self._outbox.setpoint(v_m_s, yaw_rate_rad_s, ttl_ms, now_ns)

    def duty(self, left: float, right: float, ttl_ms: int, now_ns: HostNs) -> None:
        """Send motor duties, -1..1, which a device obeys in bring-up mode only, capped."""
        self._outbox.duty(left, right, ttl_ms, now_ns)

    def stop(self, cause: int, now_ns: HostNs) -> int:
        """Latch a stop, repeated until the device has said yes, in a later session if need be.

        It is sent at once in any state: a device obeys a stop outside a session too.
        """
        self._open_stop = max(cause, self._open_stop or 0)
        return self._command(Stop, cause, now_ns, forever=True)

    def clear_stop(self, cause: int, now_ns: HostNs) -> int:
        """Release a latched stop of this cause."""
        return self._command(ClearStop, cause, now_ns)

    def set_mode(self, mode: int, now_ns: HostNs) -> int:
        """Choose what moves the wheels."""
        return self._command(SetMode, mode, now_ns)

    def command(self, kind: type[Message], fields: tuple[int, ...], now_ns: HostNs) -> int:
        """Send any other command, its fields after the id; gives the id."""
        type_id = self._catalogue.by_class[kind].type_id
        return self._outbox.command(lambda i: kind(i, *fields), type_id, now_ns, forever=False)  # type: ignore[call-arg]  # a command's first field is its id

    def _command(
        self,
        message: Callable[[int, int], Message],
        value: int,
        now_ns: HostNs,
        *,
        forever: bool = False,
    ) -> int:
        type_id = self._catalogue.by_class[message].type_id  # type: ignore[index]  # a class
        return self._outbox.command(lambda i: message(i, value), type_id, now_ns, forever=forever)
