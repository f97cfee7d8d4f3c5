"""Kinds of faults of the link: effects of cables, adapters, drivers and interference on bytes.

On a CAN bus these faults act on frames. A CAN controller detects a damaged frame by its CRC, and
the sender repeats it. So bit flips and bursts cause delays, but never wrong data.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_device.faults.knobs import either
from sim_device.faults.spec import Choice, FaultKind, Number, Value

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_device.faults.knobs import Knobs

_WAY = Choice("way", "direction; up is from device to host", ("up", "down", "both"), "both")


def _share(default: float, what: str) -> Number:
    return Number("rate", f"share of the link's bytes {what}", "", default, 0.0, 1.0)


def _flips(knobs: Knobs, values: Mapping[str, Value]) -> None:
    for wire in knobs.wires(str(values["way"])):
        wire.flips = either(wire.flips, float(values["rate"]))


def _loss(knobs: Knobs, values: Mapping[str, Value]) -> None:
    for wire in knobs.wires(str(values["way"])):
        wire.loss = either(wire.loss, float(values["rate"]))


def _duplicates(knobs: Knobs, values: Mapping[str, Value]) -> None:
    for wire in knobs.wires(str(values["way"])):
        wire.duplicates = either(wire.duplicates, float(values["rate"]))
        wire.duplicate_bytes = max(wire.duplicate_bytes, round(float(values["length"])))


def _bursts(knobs: Knobs, values: Mapping[str, Value]) -> None:
    for wire in knobs.wires(str(values["way"])):
        wire.bursts = either(wire.bursts, float(values["rate"]))
        wire.burst_bytes = max(wire.burst_bytes, round(float(values["length"])))


def _latency(knobs: Knobs, values: Mapping[str, Value]) -> None:
    for wire in knobs.wires(str(values["way"])):
        wire.latency_us += round(1000.0 * float(values["ms"]))


def _jitter(knobs: Knobs, values: Mapping[str, Value]) -> None:
    for wire in knobs.wires(str(values["way"])):
        wire.jitter_us += round(1000.0 * float(values["ms"]))


def _silence(knobs: Knobs, values: Mapping[str, Value]) -> None:
    for wire in knobs.wires(str(values["way"])):
        wire.silent = True


def _wrong_baud(knobs: Knobs, values: Mapping[str, Value]) -> None:
    for wire in knobs.wires(str(values["way"])):
        wire.garbled = True


def _unplug(knobs: Knobs, values: Mapping[str, Value]) -> None:
    del values
    knobs.unplugged = True


def _bus_off(knobs: Knobs, values: Mapping[str, Value]) -> None:
    del values
    knobs.bus_off = True
    for wire in knobs.wires("both"):
        wire.silent = True


WIRE_KINDS = (
    FaultKind(
        "bit-flips",
        "Single bits are flipped.",
        "bit-flips@10:5:rate=0.001",
        (_share(0.001, "with a wrong bit"), _WAY),
        _flips,
    ),
    FaultKind(
        "byte-loss",
        "Single bytes are lost, as in an overrun receiver.",
        "byte-loss@10:5:rate=0.001,way=up",
        (_share(0.001, "lost"), _WAY),
        _loss,
    ),
    FaultKind(
        "duplicates",
        "A sequence of bytes arrives twice, as from a USB driver that repeats a packet.",
        "duplicates@10:5:length=62",
        (
            _share(0.001, "after which the last bytes are repeated"),
            Number("length", "number of repeated bytes", "B", 62.0, 1.0, 1024.0),
            _WAY,
        ),
        _duplicates,
    ),
    FaultKind(
        "bursts",
        "A sequence of bytes is noise, as from a motor's spark or a loose plug.",
        "bursts@10:5:rate=0.001,length=20",
        (
            _share(0.0005, "at which a burst begins"),
            Number("length", "number of noisy bytes", "B", 16.0, 1.0, 1024.0),
            _WAY,
        ),
        _bursts,
    ),
    FaultKind(
        "latency",
        "All bytes are delayed.",
        "latency@10:20:ms=50,way=down",
        (Number("ms", "delay", "ms", 20.0, 0.0, 60_000.0), _WAY),
        _latency,
    ),
    FaultKind(
        "jitter",
        "Bytes are delayed by a random time and stay in order.",
        "jitter@10:20:ms=15",
        (
            Number("ms", "longest delay, uniform distribution", "ms", 10.0, 0, 60_000),
            _WAY,
        ),
        _jitter,
    ),
    FaultKind(
        "silence",
        "Nothing arrives, but the port stays open.",
        "silence@10:0.5:way=up",
        (_WAY,),
        _silence,
    ),
    FaultKind(
        "can-bus-off",
        "The device's CAN controller goes off the bus after too many errors, and returns after "
        "the duration. Only on a CAN bus.",
        "can-bus-off@10:0.3",
        (),
        _bus_off,
    ),
    FaultKind(
        "wrong-baud",
        "Both ends use different baud rates, so all bytes are noise. (A pseudo-terminal has no "
        "rate, so a real mismatch of `--baud` has no effect there.)",
        "wrong-baud@0",
        (_WAY,),
        _wrong_baud,
    ),
    FaultKind(
        "unplug",
        "The plug is pulled, and put back after the duration. The port disappears and returns "
        "under the same `--pty-link`. The device keeps running.",
        "unplug@30:4",
        (),
        _unplug,
    ),
)
