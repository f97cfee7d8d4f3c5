"""The robot file against the device, told once as a run begins."""

from __future__ import annotations

import contextlib
import threading
from typing import TYPE_CHECKING

from bridge.asking import Asker
from bridge.bench.values import Difference, differences
from bridge.errors import BridgeError
from bridge.io import clock
from bridge.session_events import State
from bridge.telemetry import Severity

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bridge.io.pump import Pump
    from bridge.motion.robot_model import RobotModel

_POLL_S = 0.05


@contextlib.contextmanager
def compared(pump: Pump, model: RobotModel) -> Iterator[None]:
    """Once device and host agree, ask for its parameters and tell where the robot file differs.

    From a thread of its own: the run does not wait for it. A device without parameters has
    nothing to tell.
    """
    over = threading.Event()

    def look() -> None:
        while pump.host.session.state is not State.READY:
            if over.wait(_POLL_S):
                return
        with contextlib.suppress(BridgeError):
            for difference in differences(Asker(pump.host, pump.call).list_parameters(), model):
                _tell(pump, difference)

    thread = threading.Thread(target=look, name="compare", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()


def _tell(pump: Pump, difference: Difference) -> None:
    name, unit, device, file = difference
    shown = "" if unit == "ratio" else f" {unit}"
    text = f"{name}: the device has {device:.7g}{shown}, the robot file {file:.7g}{shown}"
    pump.call(lambda: pump.host.event(clock.now(), Severity.WARNING, "session", "parameter", text))
