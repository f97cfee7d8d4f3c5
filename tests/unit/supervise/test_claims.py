"""The phase that the device reports, compared with its measured motion."""

from __future__ import annotations

import pytest

from protocol.messages.values import PlannerPhase
from support.sweeping_device import (
    CRUISE_M,
    IDLE,
    LANE,
    STEP,
    TURN,
    started,
)
from support.watching import planner


@pytest.mark.parametrize(
    "phase", [IDLE, PlannerPhase.PAUSED, PlannerPhase.FINISHED, PlannerPhase.ABORTED]
)
def test_a_device_that_reports_standstill_must_stand(phase: PlannerPhase) -> None:
    for speed, rate, found in (
        *((0.0005, 0.0, False), (0.0007, 0.0, True), (-0.0007, 0.0, True)),
        *((0.0, 0.14, False), (0.0, 0.17, True), (0.0, -0.17, True)),
    ):
        device = started("recovery")
        device.emit_state(planner(phase))
        device.go(20)
        device.go(110, speed, rate=rate)
        assert bool(device.found) is found, (speed, rate)
        if found:
            assert device.data["phase"] == phase.name.lower()
            assert "moves" in device.found[0]


def test_a_claim_is_tested_once_it_is_a_second_old() -> None:
    device = started("recovery")
    device.emit_state(planner(PlannerPhase.PAUSED))
    device.go(49, CRUISE_M)
    assert device.found == []
    device.go(3, CRUISE_M)
    assert len(device.found) == 1
    assert device.data["for_s"] == pytest.approx(1.0, abs=0.03)
    assert device.data["path_m"] == pytest.approx(0.2, abs=0.01)


def test_a_new_claim_is_not_checked_against_earlier_motion() -> None:
    device = started("recovery")
    device.emit_state(planner(LANE))
    device.go(100, CRUISE_M)
    device.emit_state(planner(PlannerPhase.PAUSED))
    device.go(150)
    assert device.found == []


@pytest.mark.parametrize(
    ("onboard", "speed", "found"),
    [
        *(("u-shape", 0.0011, False), ("u-shape", 0.0013, True), ("u-shape", -0.0013, True)),
        # An arc of 1 rad on the radius W, 16 cm, is allowed too: 22 cm in a second.
        *(("recovery", 0.0043, False), ("recovery", 0.0045, True), ("recovery", -0.0045, True)),
    ],
)
def test_a_turn_makes_no_way_beyond_an_arc(onboard: str, speed: float, *, found: bool) -> None:
    device = started(onboard)
    device.emit_state(planner(TURN))
    device.go(110, speed, rate=1.0)
    assert bool(device.found) is found
    if found:
        assert "drives" in device.found[0]
        assert device.data["turn_rad"] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("phase", [LANE, STEP])
@pytest.mark.parametrize(("rate", "found"), [(0.55, False), (0.65, True), (-0.65, True)])
def test_a_straight_run_does_not_bend(phase: PlannerPhase, rate: float, *, found: bool) -> None:
    device = started("u-shape")
    device.emit_state(planner(phase))
    device.go(110, CRUISE_M, rate=rate)
    assert bool(device.found) is found
    if found:
        assert "turns" in device.found[0]
    device = started("recovery")
    device.emit_state(planner(phase))
    device.go(110, CRUISE_M, rate=rate)
    assert device.found == [], "the protocol reports a perimeter pass as a lane too"


def test_recovery_phases_may_do_anything() -> None:
    device = started("paper")
    device.emit_state(planner(PlannerPhase.RECOVERY_RETURN))
    device.go(110, CRUISE_M, rate=1.0)
    assert device.found == []
