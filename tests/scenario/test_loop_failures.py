"""Failures that must end in a stop: an error in a run's loop, and two simultaneous stop causes."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from typing import TYPE_CHECKING, Any

import pytest

from bridge.coverage.runner import PlanRunner
from bridge.errors import BridgeError
from bridge.io.owner_client import ask
from bridge.record.reader import LogReader
from protocol.messages.values import StopCause
from support.cli import sweepctl
from support.emulated import Emulated

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from bridge.motion.observation import Observation, VelocityCommand

pytestmark = pytest.mark.usefixtures("target")

PATIENCE_S = 60.0
"""Maximum time of a step, s; only a hang is longer."""


@pytest.fixture(name="emulated")
def _emulated() -> Iterator[Emulated]:
    with Emulated() as emulated:
        yield emulated


@pytest.fixture(name="steps")
def _steps(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Raise an error in the planner at its fiftieth control step; return the number of steps."""
    whole, steps = PlanRunner.step, []

    def step(self: PlanRunner, obs: Observation) -> VelocityCommand:
        steps.append(1)
        if len(steps) >= 50:
            raise ZeroDivisionError("what nobody has foreseen\nin two lines")
        return whole(self, obs)

    monkeypatch.setattr(PlanRunner, "step", step)
    return steps


def crash_of(log: Path) -> dict[str, Any]:
    """Return the crash event in a complete log."""
    reader = LogReader(log)
    assert not reader.truncated
    events = [m.decoded for m in reader.messages(["/events"])]
    (found,) = [e for e in events if e.kind == "crash"]
    return {"text": found.text, "data": json.loads(found.data_json)}


def test_a_defect_in_a_plan_ends_a_simulated_run_as_a_fault(
    steps: list[int], tmp_path: Path
) -> None:
    log = tmp_path / "run.mcap"
    done = sweepctl("simulate", "case-1", "--json", "--out", log)
    assert done.status == 1
    text = (
        "the run's loop failed (ZeroDivisionError: what nobody has foreseen); "
        "the device has confirmed the stop"
    )
    assert done.line == f"sweepctl: {text}"
    assert (done.json["outcome"], done.json["reason"]) == ("fault", text)
    assert done.json["duration_s"] == pytest.approx(len(steps) * 0.02, abs=0.05)
    crash = crash_of(log)
    assert crash["text"] == text
    assert "Traceback" in crash["data"]["traceback"]


@pytest.mark.realtime
def test_a_defect_in_a_plan_stops_the_robot(
    emulated: Emulated, steps: list[int], tmp_path: Path
) -> None:
    log = tmp_path / "run.mcap"
    done = sweepctl("connect", emulated.port, "--plan", "paper", "--json", "--out", log)
    assert len(steps) == 50
    assert done.status == 1
    assert emulated.holds(StopCause.SUPERVISE)
    assert "Traceback" not in done.err
    assert done.err.splitlines()[-1].endswith("the device has confirmed the stop")
    assert done.json["outcome"] == "fault"
    assert "Traceback" in crash_of(log)["data"]["traceback"]
    again = sweepctl("connect", emulated.port, "--plan", "paper", "--out", tmp_path / "2.mcap")
    assert again.status == 5
    assert "cause: supervise" in again.err, "a restart must need --clear-stop"


def once_driving(emulated: Emulated, then: Callable[[], None]) -> threading.Thread:
    """Call a function as soon as the robot moves."""

    def wait() -> None:
        deadline = time.monotonic() + PATIENCE_S
        while emulated.device.truth.v_m_s < 0.05 and time.monotonic() < deadline:
            time.sleep(0.01)
        then()

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    return thread


@pytest.mark.realtime
def test_an_invalid_request_of_another_shell_does_not_end_a_run(
    emulated: Emulated, tmp_path: Path
) -> None:
    rejected: list[str] = []

    def ask_wrongly() -> None:
        for request in (
            {"do": "get", "name": 300},
            {"do": "get", "name": -1},
            {"do": "get", "name": 10**3000},
            {"do": "set", "name": "max_speed", "value": 10**3000},
            {"do": "set", "name": "max_speed", "value": True},
            {"do": "rate", "stream": "imu", "hz": 10**3000},
            {"do": 10**3000},
        ):
            try:
                ask(emulated.port, request)
            except BridgeError as error:
                rejected.append(str(error))
        assert ask(emulated.port, {"do": "status"})["status"]["run"] == "driving"
        os.kill(os.getpid(), signal.SIGINT)

    asking = once_driving(emulated, ask_wrongly)
    done = sweepctl("connect", emulated.port, "--plan", "paper", "--out", tmp_path / "run.mcap")
    asking.join()
    assert len(rejected) == 7
    assert all(len(text) < 120 and "internal" not in text for text in rejected), rejected
    assert done.status == 0, done.err


@pytest.mark.realtime
@pytest.mark.parametrize("apart_s", [0.0, 0.002, 0.02])
def test_a_stop_reported_as_confirmed_during_ctrl_c_is_latched(
    emulated: Emulated, tmp_path: Path, apart_s: float
) -> None:
    reported: list[bool] = []

    def both() -> None:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(apart_s)
        try:
            reported.append(ask(emulated.port, {"do": "stop"})["confirmed"] is True)
        except BridgeError:
            reported.append(False)  # the run was over: no stop is reported

    asking = once_driving(emulated, both)
    done = sweepctl("connect", emulated.port, "--plan", "paper", "--out", tmp_path / "run.mcap")
    asking.join()
    latched = StopCause.OPERATOR if reported[0] else StopCause.SESSION_END
    assert emulated.holds(latched)
    assert done.status == (5 if reported[0] else 0)
    if reported[0]:
        again = sweepctl("connect", emulated.port, "--plan", "paper", "--out", tmp_path / "2.mcap")
        assert again.status == 5
        assert "cause: operator" in again.err
