"""The chip's temperature reaches the host's estimate."""

from __future__ import annotations

import pytest

from bridge.motion.estimation.ekf import Ekf
from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from tools.cli.rooms import load_room
from tools.virtual.run import run_virtual


def test_the_host_follows_the_chip_as_it_warms_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """6 °C with a time constant of 300 s give 0.39 °C in 20 s, less half a second of filter."""
    reported: list[float] = []
    warm = Ekf.warm

    def listened(self: Ekf, change_c: float) -> None:
        reported.append(change_c)
        warm(self, change_c)

    monkeypatch.setattr(Ekf, "warm", listened)
    run_virtual(load_room("empty"), RobotModel(), "paper", NullSink(), max_time_s=20.0)
    assert sum(reported) == pytest.approx(0.39, abs=0.08)
