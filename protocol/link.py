"""One end of a link: frames in, messages out, and the accounts of both.

Sans-I/O: bytes are handed in, messages and events come back, and what is to be written is
fetched with :meth:`LinkBase.data_to_send`. It does not know which end it plays beyond the
direction of the messages that it sends.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from protocol.authentication import SIGNED_TYPES
from protocol.errors import LocalError
from protocol.schema.codec import Codec
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
"""Addresses every device; for stop, hello and time requests only."""


class Received(NamedTuple):
    """An intact message that is meant for this end."""

    message: Message
    frame: Frame
    spec: MessageSpec


_Waiting = tuple[int, int, int, bytes, int, int]
"""A frame to be: node, type, stamp, payload, flags, rank. It takes its sequence number as it
leaves, or a replaced one would be a gap; a bare tuple, for there is one for every message sent."""


@dataclass(frozen=True, slots=True)
class Rejected:
    """An intact frame that this end could not use."""

    frame: Frame
    reason: str
    """``version``, ``direction``, ``type``, ``disabled``, ``payload``, or ``key``: it is marked as
    authenticated, and there is no key here, or its tag or counter is wrong."""


LinkEvent = Received | Rejected | DamagedFrame


@dataclass(slots=True)
class LinkStatistics:
    """Counts since the link was made."""

    frames_in: int = 0
    frames_out: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    damaged: int = 0
    rejected: int = 0
    lost: int = 0
    """Frames missing by their sequence numbers."""
    reordered: int = 0
    superseded: int = 0
    """Messages replaced by a newer one before they were written."""
    by_type: dict[int, int] = field(default_factory=dict)


class WrongDirectionError(LocalError):
    """A message that the other side sends."""

    def __init__(self, message: str) -> None:
        super().__init__(f"{message} is not sent in this direction")
        self.message = message


def addresses(frame: Frame, spec: MessageSpec, node: int) -> bool:
    """Whether a host's frame is for the device of this node."""
    return frame.node == node or (frame.node == NODE_ALL and spec.to_all)


class Medium(Enum):
    """What carries the bytes."""

    UART = "uart"
    CAN = "can"
    """Each frame as the 16 bytes of Linux' ``struct can_frame``."""


class LinkBase:
    """What a session needs of a link, whichever medium it runs over."""

    medium = Medium.UART

    def __init__(self, sends: Direction, *, codec: Codec | None = None) -> None:
        self.codec = codec or Codec()
        self.statistics = LinkStatistics()
        self.disabled: set[int] = set()
        """Types whose declaration the peer does not share: neither sent nor decoded."""
        self._sends = sends
        self._own_types = {s.type_id for s in self.codec.catalogue if s.direction is sends}
        self._queue: list[_Waiting] = []
        self.key: Authenticator | None = None
        """Signs what needs it once its session has begun, and checks what comes signed."""

    def receive(self, data: bytes, now_us: int) -> list[LinkEvent]:
        """Take bytes that arrived at ``now_us`` of our own clock; give what they complete."""
        raise NotImplementedError

    def data_to_send(self) -> bytes:
        """Fetch and forget what is queued."""
        raise NotImplementedError

    def forget_sequence(self) -> None:
        """Expect any sequence number next: the peer has booted anew."""
        raise NotImplementedError

    def _reject(self, frame: Frame, reason: str) -> Rejected:
        self.statistics.rejected += 1
        return Rejected(frame, reason)

    def send(  # noqa: PLR0913 - the frame, and how it waits
        self,
        message: Message,
        t_us: int,
        *,
        node: int,
        flags: int = 0,
        latest: bool = False,
        rank: int | None = None,
    ) -> bool:
        """Queue a message; False where the peer does not share its declaration.

        With ``latest`` a message of the same type that still waits is replaced: what is
        cyclic must never queue up. On CAN the lowest ``rank`` leaves first, and of equal ranks
        the first that was queued. It is the message's type unless told otherwise.

        Raises:
            WrongDirectionError: the message belongs to the other side.
            FieldRangeError: a value does not fit.
            FrameSizeError: a text is too long for a frame.
            UnknownMessageError: the catalogue does not hold the message.

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
        statistics = self.statistics
        if latest and self._queue:
            kept = [w for w in self._queue if w[1] != type_id or w[0] != node]
            replaced = len(self._queue) - len(kept)
            statistics.superseded += replaced
            statistics.frames_out -= replaced
            self._queue = kept
        self._queue.append((node, type_id, t_us, payload, flags, type_id if rank is None else rank))
        statistics.frames_out += 1
        return True

    def send_payload(self, type_id: int, payload: bytes, t_us: int, node: int) -> bool:
        """Queue what a stream's own layout has packed; False as for :meth:`send`.

        For a device's streams, of which there are hundreds a second and none is authenticated:
        the caller answers for the type, its direction, and a node and a length that fit.
        """
        if type_id in self.disabled:
            return False
        self._queue.append((node, type_id, t_us, payload, 0, type_id))
        self.statistics.frames_out += 1
        return True

    @property
    def has_data(self) -> bool:
        """True where something waits to be written."""
        return bool(self._queue)
