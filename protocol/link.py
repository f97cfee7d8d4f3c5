"""One end of a link: frames in, messages out, and the statistics of both.

Sans-I/O: the caller passes bytes in and gets messages and events back.
:meth:`LinkBase.data_to_send` returns the bytes to write. Both ends use the same class; they differ
only in the direction of their messages.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from protocol.authentication import SIGNED_TYPES
from protocol.errors import LocalError
from protocol.schema.codec import Codec
from protocol.send_queue import SendQueue
from protocol.uart.framing import (
    FLAG_AUTHENTICATED,
    MAX_NODE,
    MAX_PAYLOAD,
    DamagedFrame,
    Frame,
    check_frame,
)

if TYPE_CHECKING:
    from protocol.authentication import Authenticator
    from protocol.schema.message import Direction, Message, MessageSpec

NODE_ALL = 0
"""Node id that addresses every device. Only stop, hello and time requests use it."""


class Received(NamedTuple):
    """An intact message that is addressed to this end."""

    message: Message
    frame: Frame
    spec: MessageSpec


@dataclass(frozen=True, slots=True)
class Rejected:
    """An intact frame that this end could not use."""

    frame: Frame
    reason: str
    """Reason: ``version``, ``direction``, ``type``, ``disabled``, ``payload``, or ``key``. The
    reason ``key`` means that the frame is marked as authenticated, but cannot be verified: this end
    has no key, or the tag or the counter is wrong."""


LinkEvent = Received | Rejected | DamagedFrame


@dataclass(slots=True)
class LinkStatistics:
    """Counts since the link was created."""

    frames_in: int = 0
    frames_out: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    damaged: int = 0
    rejected: int = 0
    lost: int = 0
    """Number of missing frames, computed from gaps in the sequence numbers."""
    reordered: int = 0
    superseded: int = 0
    """Number of messages that a newer message replaced before transmission."""
    by_type: dict[int, int] = field(default_factory=dict)


class WrongDirectionError(LocalError):
    """A message that only the other end may send."""

    def __init__(self, message: str) -> None:
        super().__init__(f"{message} is not sent in this direction")
        self.message = message


def addresses(frame: Frame, spec: MessageSpec, node: int) -> bool:
    """Return True if a host's frame addresses the device with this node id."""
    return frame.node == node or (frame.node == NODE_ALL and spec.to_all)


class Medium(Enum):
    """The medium that carries the bytes."""

    UART = "uart"
    CAN = "can"
    """Classic CAN; each frame is passed as the 16 bytes of Linux' ``struct can_frame``."""


class LinkBase:
    """Interface of a link that a session uses, for any medium."""

    medium = Medium.UART

    def __init__(self, sends: Direction, *, codec: Codec | None = None) -> None:
        self.codec = codec or Codec()
        self.statistics = LinkStatistics()
        self.disabled: set[int] = set()
        """Message types that the peer declares differently. They are neither sent nor decoded."""
        self._sends = sends
        self._own_types = {s.type_id for s in self.codec.catalogue if s.direction is sends}
        self._queue = SendQueue()
        self.key: Authenticator | None = None
        """Key that signs frames and checks received tags. It signs only after its session has
        begun."""

    def receive(self, data: bytes, now_us: int) -> list[LinkEvent]:
        """Handle bytes that arrived at ``now_us`` of our clock; return the completed events."""
        raise NotImplementedError

    def data_to_send(self) -> bytes:
        """Return and remove the queued bytes."""
        raise NotImplementedError

    def forget_sequence(self) -> None:
        """Accept any sequence number next, because the peer has booted."""
        raise NotImplementedError

    def _reject(self, frame: Frame, reason: str) -> Rejected:
        self.statistics.rejected += 1
        return Rejected(frame, reason)

    def send(  # noqa: PLR0913 - the frame, and its queueing
        self,
        message: Message,
        t_us: int,
        *,
        node: int,
        flags: int = 0,
        latest: bool = False,
        rank: int | None = None,
    ) -> bool:
        """Queue a message; return False if the peer does not share its declaration.

        With ``latest``, the message replaces a queued message of the same type. On CAN the message
        with the lowest ``rank`` is sent first; messages of equal rank keep their order. The default
        rank is the message's type.

        Raises:
            WrongDirectionError: the message belongs to the other end.
            FieldRangeError: a value does not fit.
            FrameSizeError: a text is too long for a frame.
            UnknownMessageError: the message is not in the catalogue.

        """
        type_id, payload = self.codec.encode(message)
        if type_id in self.disabled:
            return False
        if type_id not in self._own_types:
            raise WrongDirectionError(type(message).__name__)
        if self.key is not None and self.key.begun and type_id in SIGNED_TYPES:
            flags |= FLAG_AUTHENTICATED
        if flags or not 0 <= node <= MAX_NODE or len(payload) > MAX_PAYLOAD:
            check_frame(node, type_id, payload, flags)
        statistics, queue = self.statistics, self._queue
        if latest and queue.frames:
            replaced = queue.supersede(node, type_id)
            statistics.superseded += replaced
            statistics.frames_out -= replaced
        queue.add((node, type_id, t_us, payload, flags, type_id if rank is None else rank))
        statistics.frames_out += 1
        return True

    def send_payload(self, type_id: int, payload: bytes, t_us: int, node: int) -> bool:
        """Queue an encoded payload; return False if the peer does not share its declaration.

        This method is faster than :meth:`send`. A device's streams use it for hundreds of frames
        per second without authentication. The caller guarantees a valid type, direction, node and
        length.
        """
        if type_id in self.disabled:
            return False
        self._queue.add((node, type_id, t_us, payload, 0, type_id))
        self.statistics.frames_out += 1
        return True

    @property
    def has_data(self) -> bool:
        """Whether frames wait to be sent."""
        return bool(self._queue.frames)
