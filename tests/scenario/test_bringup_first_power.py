"""First power on the emulated device: the checklist ends at a fault, before power increases."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.bringup.first_power import STAGES
from bridge.bringup.procedure import BringUp
from bridge.bringup.wiring import Counts, judge_stage
from bridge.motion.robot_model import RobotModel
from protocol.messages.values import StopCause
from support.bench_wire import Scripted, bringup_session
from support.miswired import Stand

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.bringup.wiring import CheckResult

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("target")]

BEFORE_POWER = (
    "pull-downs",
    "wheels free",
    "motor supply off",
    "device",
    "encoder left",
    "encoder right",
)
WITH_POWER = ("battery", "logic supply", "motors off")
STAGE_NAMES = tuple(
    f"stage {d:.0%} {side}".replace("%", " %") for d in STAGES for side in ("left", "right")
)


def first_power(
    stand: Stand, confirm: Callable[[str], bool] | None = None
) -> tuple[list[CheckResult], list[tuple[float, float]]]:
    """Run the checklist; return its results, and every duty that reached the motors."""
    duties: list[tuple[float, float]] = []
    set_duty = stand.device.plant.set_duty

    def recorded(left: float, right: float) -> None:
        duties.append((left, right))
        set_duty(left, right)

    person = Scripted(confirm=confirm or stand.confirm)
    session, _ = bringup_session(stand.device)
    with session, pytest.MonkeyPatch.context() as patch:
        patch.setattr(stand.device.plant, "set_duty", recorded)
        found = BringUp(session, person, RobotModel()).run(("first-power", "motors"))
    return found, duties


def test_a_correct_robot_passes_and_the_duty_rises_in_stages() -> None:
    stand = Stand()
    found, duties = first_power(stand)
    steps = [f.step for f in found]
    assert steps[: steps.index("motor left")] == [
        *BEFORE_POWER,
        *WITH_POWER,
        *STAGE_NAMES,
        "stop",
        "command timeout",
    ]
    assert all(f.ok for f in found[: steps.index("motor left")]), found
    largest = max(abs(duty) for pair in duties for duty in pair)
    assert largest == pytest.approx(STAGES[-1], abs=0.01)
    assert stand.device.firmware.latch.cause is StopCause.SESSION_END


@pytest.mark.parametrize(
    ("wrong", "last", "text", "largest"),
    [
        ("encoders swapped", "encoder left", "left and right are swapped", 0.0),
        ("left encoder inverted", "encoder left", "counts in reverse", 0.0),
        ("right encoder dead", "encoder right", "does not count", 0.0),
        ("motors swapped", "stage 20 % left", "left and right are swapped", 0.2),
        ("left motor inverted", "stage 20 % left", "turns backwards", 0.2),
        ("left motor dead", "stage 30 % left", "does not turn", 0.3),
    ],
)
def test_a_wiring_fault_ends_the_checklist(
    wrong: str, last: str, text: str, largest: float
) -> None:
    found, duties = first_power(Stand(wrong))
    assert (found[-1].step, found[-1].ok) == (last, False), found
    assert text in found[-1].text
    assert all(f.ok for f in found[:-1])
    assert max(abs(duty) for pair in duties for duty in pair) == pytest.approx(largest, abs=0.01)


def test_a_blocked_wheel_ends_the_checklist() -> None:
    stand = Stand()
    stand.device.plant.faults.stuck_right = True
    found, _ = first_power(stand)
    assert (found[-1].step, found[-1].ok) == ("stage 30 % right", False)
    assert "does not turn" in found[-1].text


def test_a_large_current_is_reported_before_anything_else() -> None:
    nothing = Counts(0, 0), Counts(0, 0)
    result = judge_stage("stage 10 % left", "left", nothing, 1.2, must_turn=False)
    assert result.ok is False
    assert "1.20 A" in result.text
    assert "SWITCH THE SUPPLY OFF" in result.advice


@pytest.mark.parametrize("counts", [(90, 90), (-90, -90), (90, 0), (0, 90)])
def test_an_output_that_turns_one_way_only_is_reported(counts: tuple[int, int]) -> None:
    both = Counts(0, counts[0]), Counts(0, counts[1])
    result = judge_stage("stage 20 % right", "right", both, 0.2, must_turn=False)
    assert result.ok is False
    assert "in one direction only" in result.text


@pytest.mark.parametrize(
    ("question", "last"),
    [
        ("pull-down", "pull-downs"),
        ("OFF THE FLOOR", "wheels free"),
        ("switched OFF", "motor supply off"),
        ("LEFT wheel FORWARDS", "encoder left"),
        ("supply ON", "motor supply"),
        ("duty of 10 %", "stage 10 %"),
        ("sends STOP", "stop"),
        ("no more duties", "command timeout"),
    ],
)
def test_a_no_ends_the_checklist(question: str, last: str) -> None:
    stand = Stand()
    found, duties = first_power(stand, lambda text: question not in text and stand.confirm(text))
    assert (found[-1].step, found[-1].ok) == (last, None), found
    if not last.startswith(("stop", "command")):
        assert all(pair == (0.0, 0.0) for pair in duties)


def test_a_motor_that_does_not_stop_is_reported() -> None:
    stand = Stand()
    set_duty = stand.device.plant.set_duty
    largest = [0.0]

    def welded(left: float, right: float) -> None:
        """Simulate a stuck input of the driver: it holds the largest duty so far."""
        largest[0] = max(largest[0], left)
        set_duty(left if largest[0] < STAGES[-1] - 0.01 else largest[0], right)

    person = Scripted(confirm=stand.confirm)
    session, _ = bringup_session(stand.device)
    with session, pytest.MonkeyPatch.context() as patch:
        patch.setattr(stand.device.plant, "set_duty", welded)
        found = BringUp(session, person, RobotModel()).run(("first-power",))
    assert found[-1].ok is False, found
