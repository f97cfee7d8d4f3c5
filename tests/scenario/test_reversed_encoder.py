"""A robot with a reversed encoder stops itself, and the run names it; both firmwares."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.io.ports import open_port
from protocol.messages.values import Fault
from sim_device.ports import ask_control
from support.probe import Probe
from support.two_processes import Emulator, connect

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.realtime

BRAKE_S = 1.0
"""Maximum time from standstill until the motor drivers are disabled, s."""
LONGEST_TRAVEL_M = 0.10
"""Maximum distance from the start, m. The device detects a wheel that runs away at its highest
speed within 0.25 s.
"""


def faults_at_rest(port: str) -> int:
    """Return the device's fault bits after the time in which its drivers brake."""
    probe = Probe(open_port(port))
    try:
        probe.handshake()
        probe.listen(BRAKE_S)
        return probe.status().faults
    finally:
        probe.port.close()


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_reversed_encoder_ends_the_run(tmp_path: Path, target: str, side: str) -> None:
    control = tmp_path / "control"
    fault = f"encoder-reversed@0:side={side}"
    options = ("--target", target, "--fault", fault, "--control", control)
    with Emulator(tmp_path, *options) as emulator:
        begun = ask_control(control, "truth")["truth"]
        done = connect(tmp_path, emulator.port, "--plan", "recovery", "--json")
        faults = faults_at_rest(emulator.port)
        truth = ask_control(control, "truth")["truth"]
    assert done.status == 5, done
    assert f"encoder_{side}_reversed" in done.err
    assert faults == Fault.DRIVERS_OFF | Fault[f"ENCODER_{side.upper()}_REVERSED"]
    assert truth["v_m_s"] == truth["yaw_rate_rad_s"] == 0.0
    travel_m = ((truth["x_m"] - begun["x_m"]) ** 2 + (truth["y_m"] - begun["y_m"]) ** 2) ** 0.5
    assert travel_m < LONGEST_TRAVEL_M
