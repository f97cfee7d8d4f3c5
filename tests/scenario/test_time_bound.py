"""The error bound of time stamps, with the emulator's serial line, adapters and clock drift.

The bound contains the true time. It is small if the delays of the link are declared.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from bridge.motion.robot_model import RobotModel
from bridge.run.ending import Ending
from bridge.session.records import DeviceMessage, EventRecord
from bridge.session.timesync import TimeSync
from sim_device.faults.kinds import parse_fault
from sim_device.line.line import LineSettings
from tools.cli.rooms import load_room
from tools.virtual.run import EPOCH_NS, run_virtual

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.session.records import Record
    from tools.virtual.run import VirtualRun

pytestmark = pytest.mark.usefixtures("target")

BAUD = 921_600
BYTES = 16
"""Length of the shortest frame with its delimiters, bytes; no frame takes less time on the line."""
ON_THE_LINE_NS = BYTES * 10 * 1_000_000_000 // BAUD
RUN_S = 16
SETTLED_S = 10.0


class Stamps:
    """Stores the stamp of each message, and the host time that the host computes for it."""

    def __init__(self) -> None:
        self.rows: list[tuple[int, int, int]] = []
        """Rows of stamp (µs), host time (ns), bound (ns)."""
        self.late: list[tuple[int, int, int]] = []
        """Rows of messages after ten seconds."""
        self.events: list[EventRecord] = []

    def write(self, record: Record) -> None:
        if isinstance(record, EventRecord):
            self.events.append(record)
        elif isinstance(record, DeviceMessage) and record.publish_ns is not None:
            assert record.bound_ns is not None
            row = record.t_us, record.publish_ns, record.bound_ns
            self.rows.append(row)
            if record.log_ns - EPOCH_NS > SETTLED_S * 1e9:
                self.late.append(row)

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Do nothing: there is nothing to close."""


def listen(
    latency_us: int, drift_ppm: float, declared_ns: tuple[int, int], *faults: str
) -> tuple[Stamps, float, float]:
    """Return a resting robot's stamps, their share inside the bound, and the bound's p95 (ms)."""
    stamps, seconds = Stamps(), [0]

    def declare(made: VirtualRun) -> None:
        made.host.ingest.sync = TimeSync(*declared_ns)

    def ended() -> Ending | None:
        seconds[0] += 1
        return Ending("stopped", "heard enough", 0) if seconds[0] > RUN_S else None

    texts = (f"clock-drift@0:ppm={drift_ppm}", *faults)
    run_virtual(
        load_room("empty"),
        RobotModel(),
        None,
        stamps,
        noise="none",
        line=LineSettings(BAUD, latency_us),
        faults=[parse_fault(text) for text in texts],
        prepare=declare,
        ended=ended,
    )
    inside = 0
    for t_us, host_ns, bound_ns in stamps.rows:
        true_ns = EPOCH_NS + t_us * 1000.0 / (1.0 + drift_ppm * 1e-6)
        inside += abs(host_ns - true_ns) <= bound_ns
    bounds = sorted(bound_ns for _, _, bound_ns in stamps.late)
    return stamps, inside / len(stamps.rows), bounds[int(0.95 * len(bounds))] / 1e6


# Without drift (0 ppm), device and adapter stay in phase: each byte waits for an equal time.
@pytest.mark.parametrize("drift_ppm", [-100.0, 0.0, 30.0])
def test_at_an_adapter_of_1_ms_the_bound_is_true_and_below_a_tenth_of_it(drift_ppm: float) -> None:
    stamps, inside, p95_ms = listen(1_000, drift_ppm, (ON_THE_LINE_NS, ON_THE_LINE_NS))
    assert len(stamps.late) > 1_000
    assert inside >= 0.999
    assert p95_ms < 0.1


def test_at_an_adapter_of_16_ms_it_is_true_too() -> None:
    _, inside, p95_ms = listen(16_000, 100.0, (ON_THE_LINE_NS, ON_THE_LINE_NS))
    assert inside >= 0.999
    assert p95_ms < 0.2


def test_asymmetric_delays_cause_no_error_if_declared() -> None:
    """The delay from the device to the host is 3 ms longer than in the other direction.

    If it is not declared, the bound contains half of the difference, which is correct too.
    """
    slow_up = "latency@0:ms=3,way=up"
    _, inside, p95_ms = listen(1_000, -60.0, (ON_THE_LINE_NS, ON_THE_LINE_NS + 3_000_000), slow_up)
    assert inside >= 0.999
    assert p95_ms < 0.15
    _, inside, p95_ms = listen(1_000, -60.0, (0, 0), slow_up)
    assert inside >= 0.999
    assert 1.5 < p95_ms < 2.0
