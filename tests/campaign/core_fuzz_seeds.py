"""Initial scripts for a fuzzer of the C firmware: normal and hostile sessions, plans.

    PYTHONPATH=tests python -m campaign.core_fuzz_seeds FOLDER

Each file is an input of ``board_host/fuzz.c``: a byte that selects the start, then a script.
"""

from __future__ import annotations

import random
import sys
from pathlib import Path

from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from support.random_scripts import Writer
from support.script_format import Readings, script

NOTHING, DRIVING, PLANNING = b"\0", b"\1", b"\2"
PLANS = 24


def frames() -> bytes:
    """Return one frame of every host message, for the board to complete, and 50 ms after each."""
    pieces: list[bytes] = []
    for spec in CATALOGUE:
        if spec.direction is Direction.HOST:
            payload = bytes(range(1, spec.layout.size + 1))
            head = bytes((ord("F"), 1, spec.type_id, 0, 0, 0, 0, len(payload)))
            pieces.append(head + payload + b"S\x50\xc3\0\0\0\0")
    return b"".join(pieces)


def plan(rng: random.Random) -> bytes:
    """Return readings during a plan: walls near and far, contacts, turning wheels."""
    writer = Writer()
    left = right = 0
    for _ in range(40):
        left, right = left + rng.randrange(-40, 90), right + rng.randrange(-40, 90)
        writer.read(
            Readings(
                (left, right),
                (0, 0, 16384 + rng.randrange(3), 0, 0, 0, rng.randrange(-12_000, 12_000)),
                rng.choice([40, 50, 300, 2000, 0xFFFF]),
                contacts=rng.choice([0, 0, 0, 1, 2, 3, 4]),
                ultrasonic_age_us=rng.randrange(62_000),
            )
        )
        writer.wait(rng.choice([20_000, 100_000, 700_000]))
    return script(writer.acts)


def main() -> None:
    """Write the files."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    session = Writer()
    session.begin()
    session.drive(2000, 300, 10)
    bus = Writer(can=True)
    bus.begin()
    (folder / "session").write_bytes(NOTHING + script(session.acts))
    (folder / "bus").write_bytes(NOTHING + script(bus.acts))
    for name, begun in (("nothing", NOTHING), ("driving", DRIVING), ("planning", PLANNING)):
        (folder / f"frames-{name}").write_bytes(begun + frames())
    for seed in range(PLANS):
        (folder / f"plan-{seed}").write_bytes(PLANNING + plan(random.Random(seed)))


if __name__ == "__main__":
    main()
