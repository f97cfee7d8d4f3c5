"""Cost of authentication: bytes and frames on the line, CPU time of a tag and of its check.

    PYTHONPATH=tests python -m bench.signing

It sends `velocity_setpoint`, which a driven robot gets 50 times a second, alternately with and
without a key. Times are CPU times. Each cost is the median of the rounds' own differences.
"""

from __future__ import annotations

import argparse
import statistics
import time

from protocol.authentication import Authenticator
from protocol.can.frames import RECORD
from protocol.can.link import CanLink
from protocol.link import LinkBase, Received
from protocol.messages.host import TimeRequest, VelocitySetpoint
from protocol.schema.message import Direction
from protocol.uart.framing import FLAG_AUTHENTICATED
from protocol.uart.link import Link

COUNT = 1000
SESSION = (1, 2, 3)
"""Boot id, session id, challenge."""


def link(kind: type[LinkBase], end: Direction, *, key: bool) -> LinkBase:
    """Return one end of a link, with or without the key and the session."""
    made = kind(end)
    if key:
        made.key = Authenticator(bytes(range(16)))
        made.key.begin(*SESSION)
    return made


def one_round(kind: type[LinkBase], *, key: bool) -> tuple[float, float, int]:
    """Return the CPU time to send and to receive one message, µs, and its length on the line."""
    host, device = (link(kind, end, key=key) for end in (Direction.HOST, Direction.DEVICE))
    host.send(TimeRequest(1), 0, node=1)  # short stamps on a bus need a full stamp before them
    device.receive(host.data_to_send(), 0)
    begun_ns = time.process_time_ns()
    parts = []
    for index in range(COUNT):
        host.send(VelocitySetpoint(2000, index, 200, index & 0xFF), index, node=1)
        parts.append(host.data_to_send())
    sent_ns = time.process_time_ns()
    events = [event for part in parts for event in device.receive(part, 0)]
    done_ns = time.process_time_ns()
    taken = [
        event
        for event in events
        if isinstance(event, Received)
        and bool(event.frame.version_flags & FLAG_AUTHENTICATED) is key
    ]
    if len(taken) != COUNT:
        raise SystemExit(f"{len(taken)} of {COUNT} were taken")
    to_us = 1e-3 / COUNT
    return (sent_ns - begun_ns) * to_us, (done_ns - sent_ns) * to_us, max(map(len, parts))


def measure(rounds: int) -> None:
    """Print size and time of a tag on a serial line and on a bus."""
    print("| velocity_setpoint | on the line | with a key | sending it, more | taking it, more |")
    print("|---|---|---|---|---|")
    media: tuple[tuple[str, type[LinkBase], int, str], ...] = (
        ("serial line", Link, 1, "bytes"),
        ("CAN", CanLink, RECORD.size, "frames"),
    )
    for name, kind, size, unit in media:
        pairs = [(one_round(kind, key=False), one_round(kind, key=True)) for _ in range(rounds)]
        sign, check = (
            statistics.median(signed[which] - plain[which] for plain, signed in pairs)
            for which in (0, 1)
        )
        plain, signed = (pairs[0][which][2] // size for which in (0, 1))
        print(
            f"| {name} | {plain} {unit} | {signed} {unit} | {sign:.1f} us | {check:.1f} us |",
            flush=True,
        )


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--rounds", type=int, default=25)
    measure(options.parse_args().rounds)


if __name__ == "__main__":
    main()
