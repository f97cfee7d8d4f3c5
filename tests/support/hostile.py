"""Simulated wires with faults, which can be composed and have a random seed.

The classes do no I/O: bytes go in with :meth:`Wire.push`, and :meth:`Wire.pull` returns the bytes
that have arrived until a time. A wrapper acts on the pieces of the wire inside it. So
``Lossy(Chunked(Pipe(), 1), p=0.2, rng=rng)`` loses single bytes, but ``Chunked(Lossy(Pipe(), p=0.2,
rng=rng), 1)`` loses whole writes. A wire transports bytes in one direction. Times are integers in
microseconds, of any monotonic clock.
"""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import random


class Piece(NamedTuple):
    """Bytes that arrive together, and their arrival time."""

    at_us: int
    data: bytes


class Wire:
    """Base class of the wrappers: passes on the pieces of the wire inside."""

    def __init__(self, inner: Wire | None = None) -> None:
        self._inner = inner

    def push(self, data: bytes, now_us: int) -> None:
        """Write bytes at the sending end."""
        self._inside.push(data, now_us)

    def pull(self, now_us: int) -> list[bytes]:
        """Return the bytes that have arrived at the receiving end, in order of arrival."""
        return [piece.data for piece in self.arrived(now_us)]

    def next_us(self) -> int | None:
        """Return the time of the next arrival; None if no bytes are in transit."""
        return self._inside.next_us()

    def arrived(self, now_us: int) -> list[Piece]:
        """Return the bytes of :meth:`pull` as pieces with arrival times."""
        return [out for piece in self._inside.arrived(now_us) for out in self.misbehave(piece)]

    def misbehave(self, piece: Piece) -> list[Piece]:
        """Return the pieces that replace one piece."""
        return [piece]

    @property
    def _inside(self) -> Wire:
        assert self._inner is not None, "the innermost wire is a Pipe"
        return self._inner


class Pipe(Wire):
    """The innermost wire: preserves the order, loses nothing, delays bytes by ``latency_us``."""

    def __init__(self, latency_us: int = 0) -> None:
        super().__init__()
        self.latency_us = latency_us
        """Latency of bytes pushed from now on, µs; they do not overtake earlier bytes."""
        self._way: list[Piece] = []

    def push(self, data: bytes, now_us: int) -> None:
        """Write bytes; empty bytes make no piece."""
        if data:
            self._way.append(Piece(now_us + self.latency_us, data))

    def arrived(self, now_us: int) -> list[Piece]:
        """Return the pieces whose arrival time has come."""
        count = 0
        while count < len(self._way) and self._way[count].at_us <= now_us:
            count += 1
        done, self._way = self._way[:count], self._way[count:]
        return done

    def next_us(self) -> int | None:
        """Return the arrival time of the oldest piece."""
        return self._way[0].at_us if self._way else None


class Chunked(Wire):
    """Splits pieces into parts of at most ``size`` bytes, like the reads of a slow port."""

    def __init__(self, inner: Wire, size: int) -> None:
        super().__init__(inner)
        self._size = size

    def misbehave(self, piece: Piece) -> list[Piece]:
        """Split one piece."""
        at_us, data = piece
        return [Piece(at_us, data[i : i + self._size]) for i in range(0, len(data), self._size)]


class _Chance(Wire):
    """A wire with a fault that affects each piece with probability ``p``."""

    def __init__(self, inner: Wire, p: float, rng: random.Random) -> None:
        super().__init__(inner)
        self._p = p
        self._rng = rng
        self.befell = 0
        """Number of affected pieces so far."""

    def misbehave(self, piece: Piece) -> list[Piece]:
        """Affect a piece, or pass it unchanged."""
        if self._rng.random() >= self._p:
            return [piece]
        self.befell += 1
        return self.hit(piece)

    def hit(self, piece: Piece) -> list[Piece]:
        """Return the pieces that replace an affected piece."""
        raise NotImplementedError


class Lossy(_Chance):
    """Loses pieces."""

    def hit(self, piece: Piece) -> list[Piece]:  # noqa: ARG002 - it is lost in any case
        """Return nothing."""
        return []


class BitFlips(_Chance):
    """Inverts one bit of a piece."""

    def hit(self, piece: Piece) -> list[Piece]:
        """Invert a random bit of the piece."""
        data = bytearray(piece.data)
        data[self._rng.randrange(len(data))] ^= 1 << self._rng.randrange(8)
        return [Piece(piece.at_us, bytes(data))]


class Burst(_Chance):
    """Replaces up to ``longest`` bytes of a piece by noise, like a spark of a motor."""

    def __init__(self, inner: Wire, p: float, rng: random.Random, longest: int = 16) -> None:
        super().__init__(inner, p, rng)
        self._longest = longest

    def hit(self, piece: Piece) -> list[Piece]:
        """Overwrite some consecutive bytes."""
        data = bytearray(piece.data)
        first = self._rng.randrange(len(data))
        for i in range(first, min(len(data), first + self._rng.randint(1, self._longest))):
            data[i] = self._rng.randrange(256)
        return [Piece(piece.at_us, bytes(data))]


class CutTail(_Chance):
    """Loses the end of a piece, like an overrun receive buffer."""

    def hit(self, piece: Piece) -> list[Piece]:
        """Keep a part of the piece."""
        kept = piece.data[: self._rng.randrange(len(piece.data))]
        return [Piece(piece.at_us, kept)] if kept else []


class Duplicating(_Chance):
    """Duplicates a piece."""

    def hit(self, piece: Piece) -> list[Piece]:
        """Return the piece twice."""
        return [piece, piece]


class Garbage(_Chance):
    """Puts up to ``longest`` random bytes before a piece."""

    def __init__(self, inner: Wire, p: float, rng: random.Random, longest: int = 64) -> None:
        super().__init__(inner, p, rng)
        self._longest = longest

    def hit(self, piece: Piece) -> list[Piece]:
        """Return noise, then the piece."""
        noise = self._rng.randbytes(self._rng.randint(1, self._longest))
        return [Piece(piece.at_us, noise), piece]


class Delayed(Wire):
    """Delays each piece by a random time; order is kept unless ``reorder``."""

    def __init__(
        self, inner: Wire, rng: random.Random, *, low_us: int, high_us: int, reorder: bool = False
    ) -> None:
        super().__init__(inner)
        self._rng = rng
        self._low_us, self._high_us, self._reorder = low_us, high_us, reorder
        self._last_us = 0
        self._count = 0
        self._held: list[tuple[int, int, bytes]] = []

    def arrived(self, now_us: int) -> list[Piece]:
        """Take the new pieces and return those whose delay is over."""
        for at_us, data in self._inside.arrived(now_us):
            due_us = at_us + self._rng.randint(self._low_us, self._high_us)
            if not self._reorder:
                due_us = self._last_us = max(due_us, self._last_us)
            heapq.heappush(self._held, (due_us, self._count, data))
            self._count += 1
        out: list[Piece] = []
        while self._held and self._held[0][0] <= now_us:
            due_us, _, data = heapq.heappop(self._held)
            out.append(Piece(due_us, data))
        return out

    def next_us(self) -> int | None:
        """Return the earlier time of a held piece and of the next arrival."""
        moments = [self._inside.next_us(), self._held[0][0] if self._held else None]
        return min((m for m in moments if m is not None), default=None)


class Dead(Wire):
    """Loses everything from ``from_us`` to ``to_us``, like a plug pulled and put back."""

    def __init__(self, inner: Wire, from_us: int, to_us: int) -> None:
        super().__init__(inner)
        self._from_us, self._to_us = from_us, to_us

    def misbehave(self, piece: Piece) -> list[Piece]:
        """Lose the pieces that arrive meanwhile."""
        return [] if self._from_us <= piece.at_us < self._to_us else [piece]
