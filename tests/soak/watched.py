"""Checks the true pose at every logged sample: a robot that must stand still must not move."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bridge.session.records import EventRecord, TruthRecord

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.motion.geometry import Pose2
    from bridge.record.sink import Sink
    from bridge.session.records import Record
    from sim_device.sweeper import Sweeper
    from tools.virtual.run import VirtualRun

MOVES_M_S = 0.03
"""Minimum speed that counts as motion, m/s. After a bump a stopped robot may move more slowly."""
RAMP_S = 0.35
"""Time to brake from top speed, s: 0.3 m/s at 1 m/s², and a control period."""
TOP_M_S = 0.45
"""Maximum plausible speed, m/s: 1.5 times the model's top speed."""

MOVED_BY_FAULT = frozenset({"obstacle", "person", "carried", "displaced"})
"""Kinds of fault that move the robot by something other than its wheels: by hand, or by an object
that appears at the robot's place and pushes the robot."""


class Truth:
    """Passes records on, and checks the robot's true motion against the device's limits."""

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        self._device: Sweeper[Any] | None = None
        self._last: tuple[float, Pose2] | None = None
        self._latched_s: float | None = None
        self._began_s = 0.0
        self.unsafe: list[str] = []
        self.samples = 0

    def attach(self, made: VirtualRun) -> None:
        """Attach to the device before the run's first byte."""
        self._device = made.device

    def write(self, record: Record) -> None:
        """Check the truth, and pass all records on."""
        if isinstance(record, TruthRecord):
            self._look(record.log_ns * 1e-9, record.pose)
        elif isinstance(record, EventRecord) and record.data.get("fault") in MOVED_BY_FAULT:
            self._last = None
        self._sink.write(record)

    @property
    def simulated_s(self) -> float:
        """Return the time from the first check to the last."""
        return 0.0 if self._last is None else self._last[0] - self._began_s

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Close the next sink."""
        self._sink.close(summary)

    def _look(self, at_s: float, pose: Pose2) -> None:
        if not self.samples:
            self._began_s = at_s
        self.samples += 1
        last, self._last = self._last, (at_s, pose)
        device = self._device
        if device is None or last is None:
            return
        dt = at_s - last[0]
        if dt <= 0.0:
            return
        speed = last[1].distance_m(pose) / dt
        latched = device.firmware.latch.latched
        if not latched:
            self._latched_s = None
        elif self._latched_s is None:
            self._latched_s = at_s
        if speed > TOP_M_S:
            self._note(at_s, f"{speed:.2f} m/s")
        stands = self._latched_s is not None and at_s - self._latched_s > RAMP_S
        if stands and speed > MOVES_M_S:
            self._note(
                at_s, f"{speed:.2f} m/s, latched for {at_s - (self._latched_s or at_s):.2f} s"
            )

    def _note(self, at_s: float, what: str) -> None:
        if len(self.unsafe) < 10:
            self.unsafe.append(f"at {at_s % 1e6:.2f} s: {what}")
