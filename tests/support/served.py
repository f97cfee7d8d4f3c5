"""A virtual sweeper served on a pty by a thread of this process, which tests can inspect."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Self

from bridge.floor_plan.floor_plan import parse_floorplan
from sim_device.ports import PtyPort, Stopper, serve
from sim_device.sweeper import VirtualSweeper
from support.cli import sweepctl

if TYPE_CHECKING:
    from types import TracebackType

PLAN = parse_floorplan('{"walls": [[0,0],[6,0],[6,6],[0,6]], "start": [3,3,0]}')


class Served:
    """Device and port; ``device`` is the device that runs at present."""

    def __init__(self, *, seed: int = 1, noise: str = "none") -> None:
        self.device = VirtualSweeper(PLAN, noise=noise, seed=seed)
        self._pty = PtyPort()
        self.port = self._pty.path
        self._stopper = Stopper()
        self._thread = threading.Thread(
            target=serve, args=(self.device, self._pty, self._stopper), daemon=True
        )
        self._thread.start()

    def parameter(self, name: str) -> float:
        """Return a parameter's present value, as ``sweepctl param`` reads it."""
        done = sweepctl("param", "get", self.port, name, "--json")
        value: float = done.json["parameters"][0]["value"]
        return value

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stopper.stop()
        self._thread.join()
        self._pty.close()
