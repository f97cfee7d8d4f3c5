"""A virtual sweeper on a real pseudo-terminal, served by a thread of the test's own process."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Self

from bridge.floor_plan.floor_plan import parse_floorplan
from sim_device.faults.kinds import parse_fault
from sim_device.ports import PtyPort, Stopper, serve
from sim_device.rig import Rig
from sim_device.sweeper import VirtualSweeper

if TYPE_CHECKING:
    from types import TracebackType

    from bridge.motion.geometry import Pose2
    from protocol.messages.values import StopCause

PLAN = parse_floorplan('{"walls": [[0,0],[6,0],[6,6],[0,6]], "start": [3,3,0]}')


class Emulated:
    """A virtual sweeper served by a thread of this process, so that tests can read its truth."""

    def __init__(self, *faults: str) -> None:
        self.device = VirtualSweeper(PLAN, noise="none", seed=1)
        rig = Rig(self.device, faults=[parse_fault(fault) for fault in faults])
        self._pty = PtyPort()
        self.port = self._pty.path
        self._stopper = Stopper()
        self._thread = threading.Thread(
            target=serve, args=(rig, self._pty, self._stopper), daemon=True
        )
        self._thread.start()

    @property
    def pose(self) -> Pose2:
        return self.device.truth.pose

    def holds(self, cause: StopCause) -> bool:
        """Return whether the device itself has latched this cause."""
        return self.device.firmware.latch.cause is cause

    def receive_only(self) -> None:
        """Stop the device but keep its port: writes get no answer."""
        self._stopper.stop()
        self._thread.join()

    def end(self) -> None:
        self.receive_only()
        self._pty.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.end()
