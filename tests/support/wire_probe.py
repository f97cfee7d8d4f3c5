"""The connection of a probe: it sends the requested messages and stores all received messages.

It depends only on the bytes of the device's port. So the checks apply to the emulator, to a
firmware in another emulator, and to a real robot.
"""

from __future__ import annotations

import secrets
import time
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from bridge.io.ports import link_of
from protocol.authentication import Authenticator
from protocol.can.frames import RECORD
from protocol.link import NODE_ALL, LinkEvent, Medium, Received
from protocol.messages.device import Challenge, Hello
from protocol.messages.host import TimeRequest
from protocol.schema.codec import Codec
from protocol.schema.message import Direction

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.io.ports import BytePort
    from protocol.schema.message import Message
    from protocol.uart.framing import Frame

M = TypeVar("M", bound="Message")
PATIENCE_S = 2.0
"""Maximum time for an answer, s; a slower device counts as silent."""
ALIVE_S = 0.2
_WRAP, _HALF = 1 << 32, 1 << 31


class Heard(NamedTuple):
    """A message, and the probe's clock at its arrival."""

    at_us: int
    message: Message
    frame: Frame


class Ping(NamedTuple):
    """A time request and its reply; times of host and device in microseconds."""

    sent_us: int
    reached_us: int
    replied_us: int
    back_us: int

    @property
    def round_trip_us(self) -> int:
        return self.back_us - self.sent_us


def now_us() -> int:
    """Return the time of the host's clock, µs."""
    return time.monotonic_ns() // 1000


def since(earlier_us: int, later_us: int) -> int:
    """Return the microseconds from one 32-bit stamp to another; negative if the second is older."""
    return (later_us - earlier_us + _HALF) % _WRAP - _HALF


class WireProbe:
    """One port with one device behind it."""

    def __init__(
        self, port: BytePort, *, node: int | None = None, key: bytes | None = None
    ) -> None:
        self.port = port
        self.link = link_of(port.name)(Direction.HOST, codec=Codec())
        self.link.key = None if key is None else Authenticator(key)
        self.nonce = (0, 0, 0)
        """Boot id, session id and challenge, on which the tags of this session depend."""
        self.node = node
        """Node of the device; None: any that answers."""
        self.session_id = 0
        self.hello: Hello | None = None
        self.received: list[Heard] = []
        self.events: list[LinkEvent] = []
        """Received events that are no message."""
        self.raw = bytearray()
        self._command_id = secrets.randbelow(0x10000)
        self._ping = secrets.randbelow(0x40)
        self._counter = secrets.randbelow(0x100)
        self._sent_us = 0
        self._turned_us = self._received_us = now_us()
        self.held_up_us = 0
        """Longest time in this check in which one end may not have run, µs."""

    # ---- the wire -------------------------------------------------------------------------

    @property
    def on_can(self) -> bool:
        return self.link.medium is Medium.CAN

    def write(self, data: bytes) -> None:
        """Write all data, even if the port accepts only a few bytes at once."""
        end_s = time.monotonic() + PATIENCE_S
        while data:
            data = data[self.port.write(data) :]
            if data:
                assert time.monotonic() < end_s, "the port takes nothing"
                self._pump(0.001)

    def write_frame(self, can_id: int, data: bytes) -> None:
        """Send one frame on a CAN bus."""
        self.write(RECORD.pack(can_id, len(data), data))

    def send(
        self,
        message: Message,
        *,
        node: int | None = None,
        stamp_us: int | None = None,
        flags: int = 0,
    ) -> int:
        """Send a message now; return the probe's clock at the sending."""
        at_us = now_us()
        if node is None:
            node = NODE_ALL if self.node is None else self.node
        stamp = at_us if stamp_us is None else stamp_us
        self.link.send(message, stamp & 0xFFFF_FFFF, node=node, flags=flags)
        self.write(self.link.data_to_send())
        self._sent_us = at_us
        return at_us

    def _pump(self, timeout_s: float) -> None:
        self._pause(self._turned_us)
        data = self.port.wait(timeout_s)
        self._turned_us = at_us = now_us()
        if not data:
            return
        if self.session_id:
            self._pause(self._received_us)
        self._received_us = at_us
        self.raw += data
        for event in self.link.receive(data, at_us):
            if isinstance(event, Received):
                if self.node in {None, event.frame.node}:
                    self.received.append(Heard(at_us, event.message, event.frame))
                    self._take_challenge(event.message)
            else:
                self.events.append(event)

    def _take_challenge(self, message: Message) -> None:
        """Sign messages after this session's challenge, which follows the device's hello."""
        if isinstance(message, Hello) and message.session_id == self.session_id:
            self.nonce = (message.boot_id, message.session_id, 0)
        elif isinstance(message, Challenge) and self.nonce[1] == self.session_id:
            self.nonce = (*self.nonce[:2], message.counter)
            if self.link.key is not None:
                self.link.key.begin(*self.nonce)

    def _pause(self, since_us: int) -> None:
        self.held_up_us = max(self.held_up_us, now_us() - since_us)

    def until(self, true: Callable[[], bool], timeout_s: float, *, alive: bool = True) -> bool:
        """Receive until a condition is true; return False if the time has run out before.

        With ``alive`` time requests keep an open session alive.
        """
        end_us = now_us() + round(timeout_s * 1e6)
        while not true():
            left_s = (end_us - now_us()) / 1e6
            if left_s <= 0:
                return False
            if alive and self.session_id and now_us() - self._sent_us > ALIVE_S * 1e6:
                self.send(TimeRequest(self._next_ping()))
            self._pump(min(left_s, 0.05))
        return True

    def listen(self, duration_s: float, *, alive: bool = True) -> list[Heard]:
        """Receive for a time; return the messages."""
        mark = len(self.received)
        self.until(lambda: False, duration_s, alive=alive)
        return self.received[mark:]

    def forget(self) -> None:
        """Discard the messages so far."""
        self._turned_us = self._received_us = now_us()
        self.held_up_us = 0
        self.received.clear()
        self.events.clear()
        self.raw.clear()

    def of(self, kind: type[M], mark: int = 0) -> list[M]:
        """Return the messages of one kind, from the ``mark``-th received one on."""
        return [h.message for h in self.received[mark:] if isinstance(h.message, kind)]

    def wait_for(
        self,
        kind: type[M],
        timeout_s: float = PATIENCE_S,
        *,
        mark: int | None = None,
        such: Callable[[M], bool] = lambda _: True,
        alive: bool = True,
    ) -> Heard | None:
        """Return the first message of a kind from now (or from ``mark``) on, or None."""
        position = len(self.received) if mark is None else mark

        def found() -> bool:
            nonlocal position
            while position < len(self.received):
                message = self.received[position].message
                if isinstance(message, kind) and such(message):
                    return True
                position += 1
            return False

        return self.received[position] if self.until(found, timeout_s, alive=alive) else None

    def _next_ping(self) -> int:
        # Ping numbers of our own: the checks that write whole frames use others.
        self._ping = (self._ping + 1) % 0x40
        return 0x80 + self._ping
