"""Redaction of motion keys in recorded bytes: filler bytes replace the keys."""

from __future__ import annotations

from collections import deque

from cobs import cobs

from protocol.messages.host import SetKey
from protocol.schema.catalogue import CATALOGUE
from protocol.uart.framing import HEADER, MAX_ENCODED

FILLER = b"X"
"""Filler for the bytes of a key, its tag and the frame's checksum."""
_TYPE = CATALOGUE.spec(SetKey).type_id
_AT_TYPE = 3
"""Index of the type byte in an encoded frame. It follows the COBS code, version and node. None of
these bytes is 0, so COBS does not change them."""
_RUN = 4
"""Minimum length of a byte sequence that counts as part of a key in received bytes. Shorter
sequences, and sequences of one or two values, occur by chance."""
_REMEMBERED = 16
"""Number of sent key frames that echoes are compared with. A command has fewer repetitions."""


class KeyRedactor:
    """Redacts the recorded bytes of one serial port.

    The checksum is redacted too, because an attacker could use it to guess a weak key offline. An
    adapter with echo returns the sent bytes, so received bytes are redacted as well.
    """

    def __init__(self) -> None:
        self._sent: deque[tuple[bytes, bytes]] = deque(maxlen=_REMEMBERED)
        """Sent frames with a key and their redacted form."""
        self._open = b""
        """Received bytes since the last delimiter that may be the start of an echo."""
        self._runs: set[bytes] = set()
        """All secret byte sequences of length ``_RUN``. They find damaged or truncated echoes."""
        self._recent = b""
        """Last received bytes, in which a secret sequence may start."""

    def outgoing(self, data: bytes) -> bytes:
        """Return the bytes to record for sent bytes, which are whole frames."""
        if _TYPE not in data:
            return data
        pieces = data.split(b"\0")
        for index, piece in enumerate(pieces):
            if len(piece) > _AT_TYPE and piece[_AT_TYPE] == _TYPE:
                pieces[index] = _redacted(piece)
                self._sent.append((piece, pieces[index]))
                secret = piece[1 + HEADER.size :]
                runs = (secret[i : i + _RUN] for i in range(len(secret) - _RUN + 1))
                self._runs |= {run for run in runs if len(set(run)) >= _RUN - 1}
        return b"\0".join(pieces)

    def incoming(self, data: bytes) -> bytes:
        """Return the bytes to record for received bytes, in chunks of any size.

        If an echo is damaged and also split at the damage, up to three bytes of the key may remain.
        """
        if not self._sent:
            return data
        kept = bytearray(self._without_echoes(data))
        for at in self._found_runs(bytes(kept)):
            kept[at] = FILLER[0]
        return bytes(kept)

    def _found_runs(self, data: bytes) -> list[int]:
        """Return the indices of the bytes that belong to a secret sequence."""
        whole, before = self._recent + data, len(self._recent)
        self._recent = whole[-(_RUN - 1) :]
        found = [i for i in range(len(whole) - _RUN + 1) if whole[i : i + _RUN] in self._runs]
        return sorted({i + k - before for i in found for k in range(_RUN) if i + k >= before})

    def _without_echoes(self, data: bytes) -> bytes:
        """Replace whole echoes by the redacted form of the sent frames."""
        pieces = data.split(b"\0")
        for index, piece in enumerate(pieces):
            begun, self._open = self._open, (self._open + piece)[: MAX_ENCODED + 1]
            for sent, instead in self._sent:
                if len(self._open) > _AT_TYPE and sent.startswith(self._open):
                    pieces[index] = instead[len(begun) : len(begun) + len(piece)]
                    break
            if index < len(pieces) - 1:
                self._open = b""
        return b"\0".join(pieces)


def _redacted(piece: bytes) -> bytes:
    """Return a frame of equal length with the original header and filler bytes."""
    try:
        body = cobs.decode(piece)
    except cobs.DecodeError:
        return FILLER * len(piece)
    encoded: bytes = cobs.encode(body[: HEADER.size] + FILLER * (len(body) - HEADER.size))
    return encoded


def redacted_can(can_id: int, data: bytes) -> bytes:
    """Return the payload to record for a CAN frame."""
    return FILLER * len(data) if can_id >> 4 == _TYPE else data
