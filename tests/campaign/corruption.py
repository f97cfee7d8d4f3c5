"""Damage millions of frames on an idle line; count undetected errors and lost neighbours.

    PYTHONPATH=tests python -m campaign.corruption --damaged 10000000

Every second frame is damaged once. A frame counts as damaged if one of its coded bytes or the
delimiter to the next frame is changed. Its leading zero belongs to the gap between frames. An
undamaged frame that the decoder does not find is a lost neighbour. A decoded message is wrong if no
such frame was sent. The time stamp identifies each frame.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from protocol.link import Received
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION
from protocol.schema.message import Direction
from protocol.uart.batch import decode_capture
from protocol.uart.framing import HEADER, encode_frame
from protocol.uart.link import Link

if TYPE_CHECKING:
    from numpy.typing import NDArray

BLOCK = 20_000
"""Number of frames that are encoded together and used in :data:`ROUNDS` rounds of damage."""
ROUNDS = 10
STREAMED_OF = 20
"""The streaming link also reads one round in this number of rounds."""
_OFFSET_SIZE = 8


class Hit(IntEnum):
    """Kind of damage to a frame."""

    FLIP = 0
    FLIPS = 1
    BURST = 2
    CUT = 3
    LOSS = 4
    INSERTION = 5
    MERGE = 6


@dataclass
class Tally:
    """Counts of a campaign."""

    damaged: int = 0
    lost: int = 0
    """Number of intact neighbours that were not found."""
    wrong: int = 0
    """Number of frames accepted as intact that were never sent, unknown types and versions
    included."""
    streamed: int = 0
    """Number of damaged frames that the streaming link read too."""
    differences: int = 0
    """Number of messages that only the batch decoder or only the streaming link found."""
    by_hit: list[int] = field(default_factory=lambda: [0] * len(Hit))
    """Number of hits of each kind."""

    def __add__(self, other: Tally) -> Tally:
        """Return the sum of both."""
        return Tally(
            self.damaged + other.damaged,
            self.lost + other.lost,
            self.wrong + other.wrong,
            self.streamed + other.streamed,
            self.differences + other.differences,
            [mine + its for mine, its in zip(self.by_hit, other.by_hit, strict=True)],
        )


@dataclass
class Line:
    """Frames on an idle-separated line, with a zero byte before and after each frame."""

    frames: list[bytes]
    contents: list[bytes]
    """Header and payload of each frame; the stamp is its index."""
    data: NDArray[np.uint8]
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    owner: NDArray[np.int64]
    """Index of the frame that each byte belongs to."""


def make_line(rng: np.random.Generator, count: int) -> Line:
    """Return frames of every device message: random, small or zero payloads."""
    specs = [s for s in CATALOGUE if s.direction is Direction.DEVICE]
    frames: list[bytes] = []
    contents: list[bytes] = []
    choice = rng.integers(len(specs), size=count).tolist()
    style = rng.integers(3, size=count).tolist()
    noise = rng.bytes(count * 64)
    for index in range(count):
        spec = specs[choice[index]]
        size = spec.layout.size
        if spec.text_field is not None:
            size += noise[index] % 24
        payload = noise[index * 64 : index * 64 + size]
        if style[index] == 0:
            payload = bytes(b & 1 for b in payload)
        if spec.text_field is not None:
            payload = payload[: spec.layout.size] + bytes(
                b & 0x7F for b in payload[spec.layout.size :]
            )
        frames.append(b"\0" + encode_frame(1, spec.type_id, index, index, payload))
        head = HEADER.pack(PROTOCOL_VERSION << 4, 1, spec.type_id, index & 0xFF, index)
        contents.append(head + payload)
    lengths = np.array([len(f) for f in frames])
    ends = np.cumsum(lengths)
    data = np.frombuffer(b"".join(frames), np.uint8)
    return Line(frames, contents, data, ends - lengths, ends, np.repeat(np.arange(count), lengths))


def damage(
    rng: np.random.Generator, line: Line, by_hit: list[int]
) -> tuple[bytes, NDArray[np.bool_]]:
    """Damage every second frame; return the line's bytes, and which frames are damaged."""
    data = line.data.copy()
    last = len(data) - 1
    touched = np.zeros(len(line.frames), np.bool_)
    targets = np.arange(0, len(line.frames) - 1, 2)
    touched[targets] = True
    kinds = rng.integers(len(Hit), size=len(targets))
    for hit in Hit:
        by_hit[hit] += int((kinds == hit).sum())
    firsts, ends = line.starts[targets], line.ends[targets]
    at = rng.integers(firsts, ends)
    keep = np.ones(len(data), np.bool_)

    def reach(places: NDArray[np.int64]) -> None:
        hit = line.owner[places]
        touched[hit[places > line.starts[hit]]] = True

    def flip(places: NDArray[np.int64]) -> None:
        bits = (1 << rng.integers(8, size=len(places))).astype(np.uint8)
        np.bitwise_xor.at(data, places, bits)

    flip(at[kinds == Hit.FLIP])
    few, few_ends = at[kinds == Hit.FLIPS], ends[kinds == Hit.FLIPS]
    wanted = rng.integers(2, 6, size=len(few))  # bit errors that the CRC must detect
    for number in range(5):
        places = np.minimum(few + rng.integers(8, size=len(few)), few_ends - 1)
        flip(places[wanted > number])
    for kind, longest in ((Hit.BURST, 16), (Hit.LOSS, 8)):
        run = at[kinds == kind]
        length = rng.integers(2 if kind is Hit.BURST else 1, longest + 1, size=len(run))
        for step in range(longest):  # the damage may reach into the next frame
            places = np.minimum(run + step, last)[length > step]
            reach(places)
            if kind is Hit.BURST:
                data[places] = rng.integers(256, size=len(places))
            else:
                keep[places] = False
    for frame in np.flatnonzero(kinds == Hit.CUT):
        keep[at[frame] : ends[frame]] = False
    merged = ends[kinds == Hit.MERGE]
    keep[merged - 1] = False
    keep[merged] = False
    touched[line.owner[merged]] = True  # both frames are merged
    insertions = at[kinds == Hit.INSERTION]
    places = np.repeat(insertions, rng.integers(1, 13, size=len(insertions)))
    noise = rng.integers(256, size=len(places)).astype(np.uint8)
    return np.insert(data, places, noise)[np.insert(keep, places, True)].tobytes(), touched


def read(line: Line, wire: bytes) -> tuple[NDArray[np.bool_], int]:
    """Decode with numpy; return which frames were found, and how many were never sent."""
    result = decode_capture(wire)
    found = np.zeros(len(line.frames), np.bool_)
    wrong = len(result.rejected)
    for spec in CATALOGUE:
        rows = result.messages[spec.name]
        stamps = rows["t_us"].tolist()
        for row, stamp in zip(_contents(spec.type_id, rows), stamps, strict=True):
            if stamp < len(line.contents) and line.contents[stamp] == row:
                found[stamp] = True
            else:
                wrong += 1
    return found, wrong


def _contents(type_id: int, rows: NDArray[np.void]) -> list[bytes]:
    """Return header and payload, as they were sent."""
    spec = CATALOGUE.by_type[type_id]
    if spec.text_field is None:  # a row has the bytes of a frame without the version
        raw = rows.view(np.uint8).reshape(len(rows), rows.dtype.itemsize)
        raw = raw[:, _OFFSET_SIZE:].copy()
        raw[:, 0] |= PROTOCOL_VERSION << 4
        whole: list[bytes] = raw.view(f"V{raw.shape[1]}").ravel().tolist()
        return whole
    return [
        HEADER.pack(PROTOCOL_VERSION << 4 | flags, node, type_id, seq, t_us)
        + spec.layout.pack(*fixed)
        + text.encode()
        for _, flags, node, seq, t_us, *fixed, text in rows.tolist()
    ]


def differences(line: Line, wire: bytes, found: NDArray[np.bool_]) -> int:
    """Read with the streaming link; return the number of frames that only one decoder found."""
    link = Link(Direction.HOST)
    seen = np.zeros(len(found), np.bool_)
    strange = 0
    for start in range(0, len(wire), 92):  # a millisecond at 921 600 baud
        for event in link.receive(wire[start : start + 92]):
            if isinstance(event, Received):
                frame = event.frame
                head = HEADER.pack(*frame[:5])
                if frame.t_us < len(found) and head + frame.payload == line.contents[frame.t_us]:
                    seen[frame.t_us] = True
                else:
                    strange += 1
    return int((seen != found).sum()) + strange + link.statistics.rejected


def campaign(seed: int, damaged: int, *, block: int = BLOCK) -> Tally:
    """Damage at least ``damaged`` frames and return the counts."""
    rng = np.random.default_rng(seed)
    tally = Tally()
    rounds = 0
    line = make_line(rng, block)
    while tally.damaged < damaged:
        wire, touched = damage(rng, line, tally.by_hit)
        found, wrong = read(line, wire)
        hurt = int(touched.sum())
        tally.damaged += hurt
        tally.lost += int((~touched & ~found).sum())
        tally.wrong += wrong
        if rounds % STREAMED_OF == 0:
            tally.streamed += hurt
            tally.differences += differences(line, wire, found)
        rounds += 1
        if rounds % ROUNDS == 0:
            line = make_line(rng, block)
    return tally


def main() -> int:
    """Split the work between processes and print the counts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--damaged", type=int, default=10_000_000, help="frames to damage")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    begun_s = time.monotonic()
    shares = options.jobs * 4
    each = -(-options.damaged // shares)
    with ProcessPoolExecutor(options.jobs) as pool:
        seeds = [options.seed * 1000 + share for share in range(shares)]
        tally = sum(pool.map(campaign, seeds, [each] * shares), Tally())
    print(f"damaged frames              {tally.damaged}")
    for hit in Hit:
        print(f"  hits: {hit.name.lower():<20}{tally.by_hit[hit]}")
    print(f"wrong messages accepted     {tally.wrong}")
    print(f"intact neighbours lost      {tally.lost}")
    print(f"  for each damaged frame    {tally.lost / tally.damaged:.5f}")
    print(f"read by the streaming link  {tally.streamed} of the damaged ones")
    print(f"  differences to the batch  {tally.differences}")
    print(f"seconds, {options.jobs} processes        {time.monotonic() - begun_s:.0f}")
    return 1 if tally.wrong or tally.differences or tally.lost > 0.03 * tally.damaged else 0


if __name__ == "__main__":
    sys.exit(main())
