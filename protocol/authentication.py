"""Authenticated frames: a counter and a tag that only holders of the key can make.

The tag is HMAC-SHA-256 (RFC 2104, FIPS 180-4) with a key of 16 bytes. It is truncated to 8 bytes on
UART and to 6 bytes on CAN. RFC 2104, section 5, recommends at least half of the hash (16 bytes) for
signatures that stay valid. These tags are valid for 250 ms only, and the bit rate of the link
limits the number of guesses. An attacker with 50 guesses per second needs 178 000 years for all
values of 6 bytes.

The hash begins with the session's nonce (boot id, session id and the device's challenge). So a
frame from another session is never valid, whatever its counter. The counter starts at the
challenge, must increase with each frame, and wraps at 32 bits.

UART: header flag bit 0 is set, and ``counter u32 | tag 8 B`` follows the payload. The tag covers
nonce, header, payload and counter. CAN: a separate frame of type ``0x0F`` directly follows the
frames of a message. It contains ``counter (low 16 bits) | tag 6 B``. The tag covers the nonce, the
identifier and data of each frame of the message, and the whole counter.
"""

from __future__ import annotations

import hmac
import struct
from typing import TYPE_CHECKING

from protocol.errors import LocalError
from protocol.messages import ALL_MESSAGES
from protocol.messages.host import TimeRequest
from protocol.schema.message import specify

if TYPE_CHECKING:
    from collections.abc import Iterable

KEY_SIZE = 16
TRAILER = struct.Struct("<I8s")
CAN_TRAILER = struct.Struct("<H6s")
CAN_AUTH_TYPE = 0x0F
"""CAN type of the frame that contains a message's tag. No message uses this type."""
_COUNTER = struct.Struct("<I")
_NONCE = struct.Struct("<III")
_SPAN, _HALF, _SHORT = 1 << 32, 1 << 31, 1 << 16
GUARDED_TYPES = frozenset(s.type_id for s in map(specify, ALL_MESSAGES) if s.needs_tag)
"""Message types that need a tag if a key is set: velocities, duties, and every command except
stop."""
SIGNED_TYPES = GUARDED_TYPES | {specify(TimeRequest).type_id}
"""Message types that a host signs: the guarded types and time requests. A host signs time requests
because only signed frames keep a session alive."""


class BadKeyError(LocalError):
    """The key does not have the required length."""


class Authenticator:
    """Key and session counter of one end of a link."""

    def __init__(self, key: bytes) -> None:
        """Store a key; nothing is signed or accepted before :meth:`begin`.

        Raises:
            BadKeyError: the key does not have 16 bytes.

        """
        if len(key) != KEY_SIZE:
            raise BadKeyError(f"a key has {KEY_SIZE} bytes, not {len(key)}")
        self._keyed = hmac.new(key, digestmod="sha256")
        self._session: tuple[int, int, int] | None = None
        self._mac = self._keyed
        self._counter = 0

    @property
    def begun(self) -> bool:
        """True if a session has begun."""
        return self._session is not None

    def begin(self, boot_id: int, session_id: int, challenge: int) -> None:
        """Begin a session; no effect if this session has already begun."""
        session = (boot_id, session_id, challenge)
        if session == self._session:
            return
        self._session = session
        self._mac = self._keyed.copy()
        self._mac.update(_NONCE.pack(*session))
        self._counter = challenge

    def end(self) -> None:
        """End the session; nothing is signed or accepted until the next :meth:`begin`."""
        self._session = None

    def challenge(self, boot_id: int, session_id: int, number: int) -> int:
        """Return a device's challenge, which is unpredictable without the key."""
        mac = self._keyed.copy()
        mac.update(b"challenge" + _NONCE.pack(boot_id, session_id, number % _SPAN))
        value: int = _COUNTER.unpack(mac.digest()[:4])[0]
        return value

    # ---- signing --------------------------------------------------------------------------

    def sign(self, covered: bytes) -> bytes:
        """Return the trailer of a UART frame whose header and payload are ``covered``."""
        self._counter = counter = (self._counter + 1) % _SPAN
        return TRAILER.pack(counter, self._tag(covered, counter))

    def sign_can(self, frames: Iterable[tuple[int, bytes]]) -> bytes:
        """Return the data of the tag frame for ``frames`` (identifier and data of each)."""
        self._counter = counter = (self._counter + 1) % _SPAN
        tag = self._tag(covered_can(frames), counter)
        return CAN_TRAILER.pack(counter % _SHORT, tag[:6])

    # ---- checking -------------------------------------------------------------------------

    def check(self, covered: bytes, trailer: bytes) -> bool:
        """Check a UART frame's trailer; accept it and return True if it is valid and new."""
        if self._session is None or len(trailer) != TRAILER.size:
            return False
        counter, tag = TRAILER.unpack(trailer)
        return self._accept(counter, self._tag(covered, counter), tag)

    def check_can(self, frames: Iterable[tuple[int, bytes]], data: bytes) -> bool:
        """Check the data of the tag frame after ``frames``; accept it if it is valid and new."""
        if self._session is None or len(data) != CAN_TRAILER.size:
            return False
        low, tag = CAN_TRAILER.unpack(data)
        counter = self._counter + (low - self._counter) % _SHORT  # next count with these low bits
        counter = counter % _SPAN if counter != self._counter else (counter + _SHORT) % _SPAN
        return self._accept(counter, self._tag(covered_can(frames), counter)[:6], tag)

    def _accept(self, counter: int, wanted: bytes, tag: bytes) -> bool:
        # The tag is checked first and in constant time, so that a sender without the key learns
        # nothing about the counter.
        genuine = hmac.compare_digest(wanted, tag)
        if not genuine or not 0 < (counter - self._counter) % _SPAN < _HALF:
            return False
        self._counter = counter
        return True

    def _tag(self, covered: bytes, counter: int) -> bytes:
        mac = self._mac.copy()
        mac.update(covered + _COUNTER.pack(counter))
        return mac.digest()[:8]


def covered_can(frames: Iterable[tuple[int, bytes]]) -> bytes:
    """Return identifier (16 bits), length and data of all frames, concatenated."""
    return b"".join(struct.pack("<HB", can_id, len(data)) + data for can_id, data in frames)


def key_words(key: bytes) -> tuple[int, int, int, int]:
    """Return a key as the four words of :class:`SetKey`."""
    words: tuple[int, int, int, int] = struct.unpack("<4I", key)
    return words


def key_of(words: tuple[int, int, int, int]) -> bytes | None:
    """Return the key of four words; None if all are 0, which means no key."""
    return struct.pack("<4I", *words) if any(words) else None
