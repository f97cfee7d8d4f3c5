"""A motion key never reaches a record: other bytes, as many, stand in its place."""

from __future__ import annotations

from collections import deque

from cobs import cobs

from protocol.messages import SetKey
from protocol.schema.catalogue import CATALOGUE
from protocol.uart.framing import HEADER, MAX_ENCODED

FILLER = b"X"
"""What the bytes of a key, of its tag and of the frame's checksum become."""
_TYPE = CATALOGUE.spec(SetKey).type_id
_AT_TYPE = 3
"""Where a frame's type stands, behind the COBS code, the version and the node: none of them is 0,
so COBS leaves them as they are."""
_RUN = 4
"""Bytes in a row that betray a piece of a key in what is received: fewer come about by chance, as
do runs of one or two values."""
_REMEMBERED = 16
"""Frames with a key that an echo is compared with: a command is repeated fewer times."""


class KeyRedactor:
    """Goes over the bytes of one serial port before they are recorded.

    The checksum goes as well: with it a key that a person chose could be guessed without the
    robot. An adapter that echoes what is sent gives the same bytes back: those too.
    """

    def __init__(self) -> None:
        self._sent: deque[tuple[bytes, bytes]] = deque(maxlen=_REMEMBERED)
        """Frames with a key, and what was recorded in their place."""
        self._open = b""
        """Received bytes since the last delimiter, while an echo may come."""
        self._runs: set[bytes] = set()
        """Every run of secret bytes, for an echo that is damaged or cut off at its front."""
        self._recent = b""
        """Received bytes before those that come next, as many as a run may begin with."""

    def outgoing(self, data: bytes) -> bytes:
        """What to record of bytes that were sent, which are whole frames."""
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
        """What to record of bytes that were received, however they are cut.

        Of an echo that is both damaged and cut there, up to three bytes of the key may stay.
        """
        if not self._sent:
            return data
        kept = bytearray(self._without_echoes(data))
        for at in self._found_runs(bytes(kept)):
            kept[at] = FILLER[0]
        return bytes(kept)

    def _found_runs(self, data: bytes) -> list[int]:
        """Places in bytes about to be recorded that are part of a run of secret ones."""
        whole, before = self._recent + data, len(self._recent)
        self._recent = whole[-(_RUN - 1) :]
        found = [i for i in range(len(whole) - _RUN + 1) if whole[i : i + _RUN] in self._runs]
        return sorted({i + k - before for i in found for k in range(_RUN) if i + k >= before})

    def _without_echoes(self, data: bytes) -> bytes:
        """The bytes with whole echoes replaced by what was recorded of the frames sent."""
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
    """A frame of the same length, with its header and without all the rest."""
    try:
        body = cobs.decode(piece)
    except cobs.DecodeError:
        return FILLER * len(piece)
    encoded: bytes = cobs.encode(body[: HEADER.size] + FILLER * (len(body) - HEADER.size))
    return encoded


def redacted_can(can_id: int, data: bytes) -> bytes:
    """What to record of a bus frame."""
    return FILLER * len(data) if can_id >> 4 == _TYPE else data
