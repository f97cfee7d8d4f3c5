"""Checks at the start of a live run: the device's parameters and the robot's start pose."""

from __future__ import annotations

import contextlib
import threading
from typing import TYPE_CHECKING

from bridge.api.exchange import LoopExchange
from bridge.bringup.values import ParameterDifference, differences
from bridge.errors import BridgeError
from bridge.io import clock
from bridge.run.client import DeviceClient
from bridge.run.mission import Phase
from bridge.run.start_check import contradictions
from bridge.session.event_kinds import EventKind
from bridge.session.records import Severity
from bridge.session.states import State

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bridge.api.pump import Pump
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel

_POLL_S = 0.05
"""Period at which the state of the session is polled, s."""
_READING_S = 0.1
"""Interval at which ranges are read, s. It is longer than the interval of the messages, so that no
message is read twice."""
_READINGS = 9
"""Number of readings whose median is compared: odd, and enough to ignore a few wrong echoes."""


@contextlib.contextmanager
def compared(pump: Pump, model: RobotModel, *, from_file: bool) -> Iterator[None]:
    """After the handshake, compare the device's parameters with the model and report differences.

    A thread does this, so the run does not wait for it. A device without parameters is not
    compared.

    Args:
        pump: the run.
        model: the host's robot model.
        from_file: the model is from a robot file; else it is the default.

    """
    source = "the robot file" if from_file else "the host's default robot"
    over = threading.Event()

    def look() -> None:
        while pump.snapshot.session.state is not State.READY:
            if over.wait(_POLL_S):
                return
        with contextlib.suppress(BridgeError):
            for difference in differences(
                DeviceClient(LoopExchange(pump.host, pump.call)).list_parameters(), model
            ):
                _report(pump, difference, source)

    thread = threading.Thread(target=look, name="compare", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()


@contextlib.contextmanager
def start_checked(pump: Pump, model: RobotModel, plan: FloorPlan | None) -> Iterator[None]:
    """Before the robot moves, compare its ranges with the room at its start, and warn once.

    A thread does this, so the run does not wait for it. Without a ``plan`` nothing is compared.
    """
    over = threading.Event()

    def look(plan: FloorPlan) -> None:
        readings: list[tuple[float | None, float | None, float | None]] = []
        while len(readings) < _READINGS:
            if over.wait(_READING_S) or pump.snapshot.mission.phase is Phase.DRIVING:
                return
            seen = pump.snapshot.state.range
            if pump.snapshot.session.state is State.READY and seen is not None:
                readings.append((seen.ultrasonic_m, seen.infrared_left_m, seen.infrared_right_m))
        found = contradictions(plan, model, plan.start, readings)
        if found:
            text = (
                f"the robot does not seem to be at the start of {plan.name}: "
                f"{', '.join(found)}; put it there, or map and coverage will be wrong"
            )
            pump.call(
                lambda: pump.host.event(
                    clock.now(), Severity.WARNING, "room", EventKind.START, text
                )
            )

    if plan is not None:
        threading.Thread(target=look, args=(plan,), name="start", daemon=True).start()
    try:
        yield
    finally:
        over.set()


def _report(pump: Pump, difference: ParameterDifference, source: str) -> None:
    name, unit, device, file = difference
    shown = "" if unit == "ratio" else f" {unit}"
    text = f"{name}: the device has {device:.7g}{shown}, {source} has {file:.7g}{shown}"
    pump.call(
        lambda: pump.host.event(clock.now(), Severity.WARNING, "session", EventKind.PARAMETER, text)
    )
