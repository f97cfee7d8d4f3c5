"""The firmware of this folder in the simulator, in virtual time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from dust_messages import Dust

if TYPE_CHECKING:
    from tools.virtual.simulated_sweeper import SimulatedSweeper

FIRMWARE = Path(__file__).with_name("build") / "firmware.so"
pytestmark = pytest.mark.sweeper(target="core", firmware=FIRMWARE, noise="none")


def newest(sweeper: SimulatedSweeper) -> Dust:
    message = sweeper.host.snapshot().state.newest(Dust)
    assert message is not None
    return message


def test_it_counts_particles(sweeper: SimulatedSweeper) -> None:
    sweeper.run(10.0)
    first = newest(sweeper)
    sweeper.run(10.0)
    assert newest(sweeper).particles - first.particles == pytest.approx(200, abs=10)
    assert newest(sweeper).rate_hz == pytest.approx(20.0)


def test_it_still_drives_and_stops(sweeper: SimulatedSweeper) -> None:
    sweeper.enable()
    sweeper.drive(0.15, 0.0, for_s=2.0)
    sweeper.run(1.0)
    assert sweeper.truth.path_m == pytest.approx(0.3, abs=0.03)
    assert sweeper.truth.v_m_s == pytest.approx(0.0, abs=0.001)


def test_its_parameter_changes_what_it_reports(sweeper: SimulatedSweeper) -> None:
    sweeper.run(30.0)
    assert newest(sweeper).full == pytest.approx(60, abs=2)  # 600 particles of 1000
