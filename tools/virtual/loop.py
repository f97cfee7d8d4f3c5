"""The loop that joins host and virtual sweeper in virtual time, byte by byte."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from protocol.clock import HostNs

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.motion.geometry import Pose2
    from bridge.run.host import Host
    from sim_device.rig import Rig
    from sim_device.rigged import RiggedDevice

HOST_BOOT_NS = 5_000_000_000
"""Host clock at the device's boot, ns. It is not 0, so that a mix-up of the clocks shows."""
LATENCY_US = 1_000
"""One-way delay of a byte, µs: equal to a USB adapter with a latency timer of 1 ms."""
_TICKS_KEPT = 32
"""Number of true poses kept, one for each control period: 0.32 s, more than any message's delay."""


def host_ns(now_us: int) -> HostNs:
    """Return the host clock at a time since the device's boot."""
    return HostNs(now_us * 1000 + HOST_BOOT_NS)


class VirtualLoop:
    """Host, device and the bytes between them. Its memory does not grow during a run."""

    def __init__(
        self,
        body: RiggedDevice,
        rig: Rig | None,
        latency_us: int = LATENCY_US,
        on_tick: Callable[[int, int, Pose2], None] = lambda _last, _now, _pose: None,
        on_step: Callable[[], None] = lambda: None,
    ) -> None:
        """Switch the device on; :meth:`connect` joins it with a host.

        Args:
            body: The virtual robot.
            rig: The virtual robot with its line and faults; None: no line and no faults.
            latency_us: Delay of each byte, one way.
            on_tick: Called after each step of the robot's body with its time before and now (ms
                since boot) and its true pose.
            on_step: Called after each step of the device.

        """
        self.now_us = 0
        """Time since the device's boot, µs."""
        self.end_error_m: float | None = None
        """Distance of estimate and truth at the newest encoder sample of the drive, m."""
        self.max_error_m: float | None = None
        """Maximum of ``end_error_m`` over the drive, m."""
        self._body = body
        self._device: Rig | RiggedDevice = rig or body
        self._latency_us = latency_us
        self._on_tick, self._on_step = on_tick, on_step
        self._to_device: deque[tuple[int, bytes]] = deque()
        self._to_host: deque[tuple[int, bytes]] = deque()
        self._poses: dict[int, Pose2] = {}
        """True poses by the time stamp of the device, ms."""
        self._tick_ms = 0
        # The next deadline of each end is stored, because a query at every step would be slow.
        self._device_us, self._host_us = self._device.next_deadline_us(), 0

    @property
    def host_ns(self) -> HostNs:
        """Host clock, ns."""
        return host_ns(self.now_us)

    def connect(self, host: Host) -> None:
        """Join the device with this host; bytes of an earlier host are lost."""
        self.host = host
        self._to_device.clear()
        self._to_host.clear()
        host.open(self.host_ns)
        self.wake()

    def wake(self) -> None:
        """Read the deadlines of both ends again, after a call that may have changed them."""
        self._host_us = self.now_us
        self._device_us = self._device.next_deadline_us()

    def forget_errors(self) -> None:
        """Restart the measurement of the estimate's error, for another drive."""
        self.end_error_m = self.max_error_m = None

    def step(self, end_us: int | None = None) -> None:
        """Advance to the next deadline of either end or arrival of bytes, and process it.

        Args:
            end_us: Time at which to stop at the latest, µs since boot.

        """
        alive = not self.host.mission.done
        moments = [self._device_us]
        if alive:
            moments.append(self._host_us)
        if end_us is not None:
            moments.append(end_us)
        moments += [queue[0][0] for queue in (self._to_device, self._to_host) if queue]
        self.now_us = min(moments)
        self._step_device(self.now_us)
        received = self._deliver(self.now_us)
        if alive and (received or self.now_us >= self._host_us):
            self._step_host(self.now_us)

    def _step_device(self, now_us: int) -> None:
        device, to_device = self._device, self._to_device
        arrived = b""
        while to_device and to_device[0][0] <= now_us:
            arrived += to_device.popleft()[1]
        if not arrived and now_us < self._device_us:
            return
        out = device.step(arrived, now_us)
        self._device_us = device.next_deadline_us()
        if out:
            self._to_host.append((now_us + self._latency_us, out))
        self._on_step()
        if self._body.plant.tick_ms != self._tick_ms:
            self._remember()

    def _deliver(self, now_us: int) -> bool:
        """Give the host the bytes that have arrived; return whether there were any."""
        received, to_host = False, self._to_host
        while to_host and to_host[0][0] <= now_us:
            received = True
            self._receive(to_host.popleft()[1], host_ns(now_us))
        return received

    def _step_host(self, now_us: int) -> None:
        host, now_ns = self.host, host_ns(now_us)
        if now_us >= self._host_us or host.mission.pending:
            host.poll(now_ns)
        data = host.data_to_send(now_ns)
        if data:
            self._to_device.append((now_us + self._latency_us, data))
        self._host_us = -((HOST_BOOT_NS - host.next_deadline()) // 1000)

    def _remember(self) -> None:
        """Store the true pose under the device's time stamp.

        The stamp differs from the loop's time if a fault makes the device's clock drift or jump.
        """
        plant, poses = self._body.plant, self._poses
        last_ms, self._tick_ms = self._tick_ms, plant.tick_ms
        pose = plant.pose
        poses[own_ms(self._body)] = pose
        if len(poses) > _TICKS_KEPT:
            del poses[next(iter(poses))]
        self._on_tick(last_ms, self._tick_ms, pose)

    def _receive(self, data: bytes, now_ns: HostNs) -> None:
        """Give bytes to the host; after new encoder counts, compare estimate and truth."""
        host, mission = self.host, self.host.mission
        before_us = host.localisation.encoders_us
        host.receive(data, now_ns)
        if host.localisation.encoders_us == before_us:
            return
        if mission.drive_started_s is not None and mission.drive_ended_s is None:
            truth = self._poses.get(host.localisation.encoders_us // 1000)
            if truth is not None:
                self.end_error_m = error_m = truth.distance_m(host.estimator.pose)
                if self.max_error_m is None or error_m > self.max_error_m:
                    self.max_error_m = error_m


def own_ms(device: RiggedDevice) -> int:
    """Return the time stamp of the samples of the device's next control period, ms."""
    return device.clock.stamp_us(device.next_deadline_us()) // 1000
