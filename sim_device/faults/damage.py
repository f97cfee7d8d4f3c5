"""Damage to bytes and frames on a bad link; reproducible for a seed and any split of the data."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.can.frames import RECORD
from sim_device.faults.knobs import WireKnobs

if TYPE_CHECKING:
    import numpy as np

_HISTORY = 1024
"""Number of past bytes that are stored; also the maximum length of a duplicate."""


class _Hits:
    """Selects bytes to damage, each with the same independent probability.

    The class draws the distance to the next damaged byte instead of a random value per byte. So it
    is fast, and the result does not depend on how the bytes are split into pieces.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._rate = 0.0
        self._gap = 0

    def set_rate(self, rate: float) -> None:
        """Change the probability and discard the distance drawn for the old probability."""
        if rate != self._rate:
            self._rate = rate
            self._draw()

    def among(self, count: int) -> list[int]:
        """Return the positions of the damaged bytes among the next ``count`` bytes."""
        if self._rate <= 0.0:
            return []
        found = []
        while self._gap < count:
            found.append(self._gap)
            gone = self._gap + 1
            self._draw()
            self._gap += gone
        self._gap -= count
        return found

    def _draw(self) -> None:
        self._gap = int(self._rng.geometric(self._rate)) - 1 if self._rate > 0.0 else 0


class LineDamage:
    """Damages the data of one direction of the link."""

    def __init__(self, rng: np.random.Generator) -> None:
        """Start without damage."""
        flips, self._bits, loss, duplicates, bursts, self._noise, garble = rng.spawn(7)
        self._flips = _Hits(flips)
        self._loss = _Hits(loss)
        self._duplicates = _Hits(duplicates)
        self._bursts = _Hits(bursts)
        self._garble = garble
        self._knobs = WireKnobs()
        self._burst = b""
        """Remaining noise bytes of the present burst."""
        self._before = b""
        self.harmed = 0
        """Number of bytes (on a CAN bus: frames) that were lost, changed or added so far."""

    def turn(self, knobs: WireKnobs) -> None:
        """Apply new settings."""
        self._knobs = knobs
        self._flips.set_rate(knobs.flips)
        self._loss.set_rate(knobs.loss)
        self._duplicates.set_rate(knobs.duplicates)
        self._bursts.set_rate(knobs.bursts)
        if knobs.bursts <= 0.0:
            self._burst = b""

    def stretch(self, data: bytes) -> bytes:
        """Return the bytes that arrive when ``data`` is sent."""
        knobs = self._knobs
        if not data:
            return data
        if knobs.silent:
            self.harmed += len(data)
            return b""
        out = bytearray(data)
        for i in self._flips.among(len(data)):
            out[i] ^= 1 << int(self._bits.integers(8))
            self.harmed += 1
        self._spark(out)
        if knobs.garbled:
            # Sampling at a wrong rate replaces each byte by zero, one or two other bytes.
            count = int(self._garble.integers(0, 2 * len(out) + 1))
            self.harmed += len(out)
            return self._garble.bytes(count)
        lost = self._loss.among(len(data))
        again = self._duplicates.among(len(data))
        if not lost and not again:
            self._remember(out)
            return bytes(out)
        return self._cut_and_repeat(out, set(lost), set(again))

    def frame(self, record: bytes) -> list[bytes] | None:
        """Return the CAN frames that arrive; None: destroyed, and the sender repeats the frame."""
        knobs = self._knobs
        if knobs.silent:
            self.harmed += 1
            return []
        length = RECORD.size
        flipped = self._flips.among(length)
        burst = self._bursts.among(length)
        if flipped or burst or knobs.garbled:
            self.harmed += 1
            return None
        if self._loss.among(length):
            self.harmed += 1
            return []
        if self._duplicates.among(length):
            self.harmed += 1
            return [record, record]
        return [record]

    def _spark(self, out: bytearray) -> None:
        position = 0
        starts = self._bursts.among(len(out))
        while True:
            if not self._burst:  # a burst begins only outside another burst
                starts = [start for start in starts if start >= position]
                if not starts:
                    return
                position = starts.pop(0)
                self._burst = self._noise.bytes(max(1, self._knobs.burst_bytes))
            count = min(len(self._burst), len(out) - position)
            if count == 0:
                return
            out[position : position + count] = self._burst[:count]
            self._burst = self._burst[count:]
            self.harmed += count
            position += count

    def _cut_and_repeat(self, data: bytearray, lost: set[int], again: set[int]) -> bytes:
        out = bytearray()
        for i, byte in enumerate(data):
            if i in lost:
                self.harmed += 1
            else:
                out.append(byte)
                self._remember(bytes([byte]))
            if i in again:
                repeated = self._before[-max(1, self._knobs.duplicate_bytes) :]
                out += repeated
                self.harmed += len(repeated)
        return bytes(out)

    def _remember(self, data: bytes | bytearray) -> None:
        if self._knobs.duplicates > 0.0:
            self._before = (self._before + bytes(data))[-_HISTORY:]


class Delay:
    """Delays bytes and keeps their order."""

    def __init__(self, rng: np.random.Generator) -> None:
        """Start without delay."""
        self._rng = rng
        self._latency_us = self._jitter_us = 0
        self._waiting: list[tuple[int, bytes]] = []

    def turn(self, knobs: WireKnobs) -> None:
        """Apply new settings; waiting bytes keep their arrival time."""
        self._latency_us, self._jitter_us = knobs.latency_us, knobs.jitter_us

    @property
    def idle(self) -> bool:
        """Whether bytes pass without delay."""
        return not (self._latency_us or self._jitter_us or self._waiting)

    def push(self, data: bytes, now_us: int) -> None:
        """Add bytes that are sent at ``now_us``."""
        jitter_us = int(self._rng.integers(self._jitter_us + 1)) if self._jitter_us else 0
        at_us = now_us + self._latency_us + jitter_us
        if self._waiting:
            at_us = max(at_us, self._waiting[-1][0])
        self._waiting.append((at_us, data))

    def pull(self, now_us: int) -> bytes:
        """Return the bytes that have arrived by ``now_us``."""
        count = 0
        while count < len(self._waiting) and self._waiting[count][0] <= now_us:
            count += 1
        done, self._waiting = self._waiting[:count], self._waiting[count:]
        return b"".join(data for _, data in done)

    def next_us(self) -> int | None:
        """Return the time of the next arrival, µs, or None."""
        return self._waiting[0][0] if self._waiting else None

    def clear(self) -> None:
        """Discard the waiting bytes."""
        self._waiting.clear()
