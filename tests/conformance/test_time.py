"""Replies to time requests: their delays, the clock's rate and the numbers of requests."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.messages.device import TimeReply
from protocol.messages.host import TimeRequest
from support.probe import since

if TYPE_CHECKING:
    from support.probe import Ping, Probe

WORST_US = 20_000
"""Maximum time from the arrival of a request to the sending of its reply, µs. The host waits at
least that long."""
PPM = 1_000
"""Maximum clock error, ppm. A ceramic resonator is within 5000 ppm, a crystal within 100. The
check of a setpoint's age allows for 250."""


def pings(device: Probe, count: int) -> list[Ping]:
    found = [device.ping() for _ in range(count)]
    answered = [p for p in found if p is not None]
    assert len(answered) >= count - 1, f"{count - len(answered)} of {count} had no reply"
    return answered


def test_a_reply_is_sent_after_the_request_came(device: Probe) -> None:
    device.handshake()
    taken = sorted(since(p.reached_us, p.replied_us) for p in pings(device, 15))
    assert taken[0] >= 0, f"sent {-taken[0]} us before the request arrived"
    assert taken[len(taken) // 2] <= WORST_US, f"answered after {taken} us"


def test_the_devices_turnaround_is_part_of_the_round_trip(device: Probe) -> None:
    device.handshake()
    for ping in pings(device, 10):
        stay_us = since(ping.reached_us, ping.replied_us)
        assert stay_us <= ping.round_trip_us + 1_000, (
            f"{stay_us} us between its two stamps, {ping.round_trip_us} us by the host's clock"
        )


def test_its_clock_runs_as_ours_does(device: Probe) -> None:
    device.handshake()
    first = min(pings(device, 6), key=lambda p: p.round_trip_us)
    device.listen(1.0)
    last = min(pings(device, 6), key=lambda p: p.round_trip_us)
    ours_us = last.sent_us - first.sent_us
    theirs_us = since(first.reached_us, last.reached_us)
    allowed_us = first.round_trip_us + last.round_trip_us + ours_us * PPM / 1e6
    assert abs(theirs_us - ours_us) <= allowed_us, f"device {theirs_us} us, host {ours_us} us"


def test_each_request_has_its_own_reply(device: Probe) -> None:
    device.handshake()
    mark = len(device.received)
    for number in (7, 200, 7, 0, 255):
        device.send(TimeRequest(number))
    device.listen(0.3, alive=False)
    answered = [reply.ping for reply in device.of(TimeReply, mark)]
    assert answered == [7, 200, 7, 0, 255]
