"""Speed of the protocol compared with pymavlink: decoding, encoding, captures, bytes.

It also measures the cost of a key.

    PYTHONPATH=tests python -m bench.wire

All jobs run in one process, and their rounds alternate. Times are medians of CPU time. A ratio is
the median of the rounds' own ratios, because the clock of a shared machine changes between rounds.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from random import Random
from typing import TYPE_CHECKING

from bench import signing
from bench.mavlink import parse_all, same_content
from protocol.messages.device import Imu
from protocol.schema.message import Direction
from protocol.uart.batch import decode_capture
from protocol.uart.link import Link

if TYPE_CHECKING:
    from collections.abc import Callable

COUNT = 2000
CAPTURE_COUNT = 100_000
READS = (64, 92, 1024)
"""Numbers of bytes of one read from a full line: the transfer of a full-speed USB adapter (62-64),
a millisecond at 921 600 baud, and a late reader."""


class Sink:
    """Receiver of encoded bytes; it keeps them separate, as a port would take them."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.write = self.parts.append


def registers(rng: Random, count: int) -> list[tuple[int, ...]]:
    """Return rows of seven random registers; all their bits are in use, as with sensor noise."""
    return [tuple(rng.randint(-32768, 32767) for _ in range(7)) for _ in range(count)]


def ours(values: list[tuple[int, ...]]) -> list[bytes]:
    """Encode with our link, each message on an idle line."""
    link, sink = Link(Direction.DEVICE), Sink()
    for index, row in enumerate(values):
        link.send(Imu(*row), index * 10_000, node=1)
        sink.write(link.data_to_send())
    return sink.parts


def reads(parts: list[bytes], size: int) -> list[bytes]:
    """Return the same stream in reads of one size."""
    data = b"".join(parts)
    return [data[start : start + size] for start in range(0, len(data), size)]


def interleaved(
    jobs: dict[str, Callable[[], int]], counts: dict[str, int], rounds: int
) -> dict[str, list[float]]:
    """Run every job once per round; return the CPU time of each message, ns."""
    spent: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            begun_ns = time.process_time_ns()
            done = job()
            took_ns = time.process_time_ns() - begun_ns
            if done != counts[name]:
                raise SystemExit(f"{name}: {done} messages of {counts[name]}")
            spent[name].append(took_ns / done)
    return spent


def show(title: str, spent: dict[str, list[float]], own: str, peers: list[str]) -> None:
    """Print one line of the table: medians and ratios."""
    cells = [f"{statistics.median(spent[own]):6.0f} ns"]
    for peer in peers:
        ratio = statistics.median(p / o for p, o in zip(spent[peer], spent[own], strict=True))
        cells.append(f"{statistics.median(spent[peer]):6.0f} ns {ratio:6.2f}x")
    print(f"| {title:<34} | {' | '.join(cells)} |")


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--rounds", type=int, default=25)
    rounds = options.parse_args().rounds
    os.environ["MAVLINK20"] = "1"
    from pymavlink.dialects.v20 import common  # noqa: PLC0415 - reads the version at import

    dialect = same_content()
    values = registers(Random(1), COUNT)
    own = ours(values)

    def pack(module: object, name: str, rows: list[tuple[int, ...]], unit: int) -> list[bytes]:
        sink = Sink()
        send = getattr(module.MAVLink(sink, 1, 1), f"{name}_send")  # type: ignore[attr-defined]  # a generated module
        for index, row in enumerate(rows):
            send(index * unit, *row)
        return sink.parts

    raw_values = [(*row, *row[:2]) for row in values]
    same = pack(dialect, "sweeper_imu", values, 10_000)
    raw = pack(common, "raw_imu", raw_values, 10_000)

    print(f"| {'':<34} | {'ours':>9} | {'MAVLink, same':>17} | {'MAVLink RAW_IMU':>17} |")
    print(f"|{'-' * 36}|{'-' * 11}|{'-' * 19}|{'-' * 19}|")
    for size in READS:
        own_reads, same_reads, raw_reads = reads(own, size), reads(same, size), reads(raw, size)

        def receive(pieces: list[bytes] = own_reads) -> int:
            link = Link(Direction.HOST)
            return sum(len(link.receive(data)) for data in pieces)

        spent = interleaved(
            {
                "own": receive,
                "same": lambda pieces=same_reads: parse_all(dialect, pieces),  # type: ignore[misc]  # bound now
                "raw": lambda pieces=raw_reads: parse_all(common, pieces),  # type: ignore[misc]  # bound now
            },
            dict.fromkeys(("own", "same", "raw"), COUNT),
            rounds,
        )
        show(f"decode, streaming, {size} B reads", spent, "own", ["same", "raw"])

    spent = interleaved(
        {
            "own": lambda: len(ours(values)),
            "same": lambda: len(pack(dialect, "sweeper_imu", values, 10_000)),
            "raw": lambda: len(pack(common, "raw_imu", raw_values, 10_000)),
        },
        dict.fromkeys(("own", "same", "raw"), COUNT),
        rounds,
    )
    show("encode, message to bytes", spent, "own", ["same", "raw"])

    capture = b"".join(ours(registers(Random(2), CAPTURE_COUNT)))
    same_reads, raw_reads = reads(same, 4096), reads(raw, 4096)
    spent = interleaved(
        {
            "own": lambda: decode_capture(capture).message_count,
            "same": lambda: parse_all(dialect, same_reads),
            "raw": lambda: parse_all(common, raw_reads),
        },
        {"own": CAPTURE_COUNT, "same": COUNT, "raw": COUNT},
        rounds,
    )
    show("decode, capture to arrays", spent, "own", ["same", "raw"])
    print()
    sizes = [max(map(len, parts)) for parts in (own, same, raw)]
    print(
        f"bytes on the line, stamped IMU (14 B): ours {sizes[0] - 1}, {sizes[0]} on an idle line;"
    )
    print(f"MAVLink 2: {sizes[1]} for the same content, {sizes[2]} as RAW_IMU (two registers more)")
    print()
    signing.measure(rounds)


if __name__ == "__main__":
    main()
