"""The host passes changes of the IMU's temperature to the filter."""

from __future__ import annotations

import pytest

from bridge.motion.estimation.ekf import Ekf
from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from tools.cli.rooms import load_room
from tools.virtual.run import VirtualRun, run_virtual


class WarmedEkf(Ekf):
    """A filter that sums the temperature changes that it receives."""

    warmed_c = 0.0

    def warm(self, change_c: float) -> None:
        self.warmed_c += change_c
        super().warm(change_c)


def test_the_host_follows_the_chip_as_it_warms_up() -> None:
    """A rise of 6 °C with a time constant of 300 s gives 0.39 °C in 20 s, less 0.5 s of lag."""
    room = load_room("empty")
    ekf = WarmedEkf(room.start)

    def prepare(run: VirtualRun) -> None:
        run.host.estimator.ekf = ekf

    run_virtual(room, RobotModel(), "paper", NullSink(), max_time_s=20.0, prepare=prepare)
    assert ekf.warmed_c == pytest.approx(0.39, abs=0.08)
