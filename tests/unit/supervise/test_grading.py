"""The reactions to conditions over time: delay, severity and end."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, make_dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest

from bridge.errors import ConfigError
from bridge.motion.geometry import Pose2
from bridge.supervise import (
    Level,
    Reaction,
    RuleInputs,
    SuperviseSettings,
    Supervisor,
    settings_from,
)
from bridge.supervise.settings import PluggedRule
from protocol.messages.device import Encoders, Range
from protocol.messages.values import Contact, Fault
from support.watching import MODEL, STEP_S, imu, planner, power, reading, status

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel

STALL = int(Fault.MOTOR_STALL)


class Run:
    """A supervised robot whose status can report a stall, the simplest condition."""

    def __init__(self, **rules: object) -> None:
        quiet = {name: {"reaction": "off"} for name in SuperviseSettings().rules}
        self.supervisor = Supervisor(MODEL, settings_from({**quiet, **rules}))
        self.time_s = 50.0
        self.printed: list[tuple[float, Reaction]] = []

    def go(self, seconds: float, *, stalls: bool = False, **values: object) -> list[Level]:
        """Run steps of 20 ms; return the levels of the reactions."""
        begun = len(self.printed)
        for _ in range(round(seconds / STEP_S)):
            self.time_s += STEP_S
            defaults: dict[str, object] = {
                "pose": Pose2(0.0, 0.0, 0.0),
                "v_m_s": 0.0,
                "yaw_rate_rad_s": 0.0,
                "last_frame_s": self.time_s,
                "status": status(STALL if stalls else 0),
            }
            inputs = RuleInputs(time_s=self.time_s, **{**defaults, **values})  # type: ignore[arg-type]  # any field
            for reaction in self.supervisor.step(inputs):
                self.printed.append((round(self.time_s - 50.0, 3), reaction))
        return [reaction.level for _, reaction in self.printed[begun:]]

    @property
    def times(self) -> list[float]:
        return [at for at, _ in self.printed]


def stall(reaction: str, after_s: float, then: str, then_s: float) -> dict[str, object]:
    return {"reaction": reaction, "after_s": after_s, "then": then, "then_s": then_s}


def test_the_condition_must_hold_for_its_time() -> None:
    run = Run(stall=stall("pause", 0.5, "pause", 1.0))
    assert run.go(0.5, stalls=True) == []
    assert run.go(0.04, stalls=True) == [Level.PAUSE]
    assert run.times == [pytest.approx(0.52, abs=0.021)]
    assert run.go(5.0, stalls=True) == [], "there is one reaction to one occurrence"


def test_an_interruption_restarts_the_time() -> None:
    run = Run(stall=stall("pause", 0.5, "pause", 1.0))
    for _ in range(5):
        assert run.go(0.4, stalls=True) == []
        assert run.go(0.02) == []


def test_a_lasting_condition_gets_a_stronger_reaction() -> None:
    run = Run(stall=stall("report", 0.0, "stop", 1.0))
    assert run.go(0.02, stalls=True) == [Level.REPORT]
    assert run.go(0.96, stalls=True) == []
    assert run.go(0.06, stalls=True) == [Level.STOP]
    assert run.go(5.0, stalls=True) == []
    first, second = run.times
    assert second - first == pytest.approx(1.0, abs=0.021)


def test_a_short_pause_of_the_condition_is_the_same_occasion() -> None:
    run = Run(stall=stall("report", 0.0, "stop", 2.0))
    run.go(0.5, stalls=True)
    run.go(0.96)
    assert run.go(0.5, stalls=True) == [], "the first occurrence continues"
    assert run.go(0.3, stalls=True) == [Level.STOP], "2 s after the first reaction"


def test_after_a_calm_second_it_is_a_new_occasion() -> None:
    run = Run(stall=stall("report", 0.0, "stop", 2.0))
    run.go(0.5, stalls=True)
    run.go(1.04)
    assert run.go(1.5, stalls=True) == [Level.REPORT]
    assert run.go(0.6, stalls=True) == [Level.STOP]


def test_a_lesser_then_changes_nothing() -> None:
    run = Run(stall=stall("pause", 0.0, "report", 0.5))
    assert run.go(3.0, stalls=True) == [Level.PAUSE]
    run = Run(stall=stall("pause", 0.0, "off", 0.5))
    assert run.go(3.0, stalls=True) == [Level.PAUSE]


def test_a_rule_that_is_off_is_not_evaluated() -> None:
    run = Run(stall=stall("off", 0.0, "stop", 0.0))
    assert run.go(3.0, stalls=True) == []


def test_a_grave_condition_is_answered_at_once() -> None:
    cliff = {"reaction": "report", "after_s": 0.5, "then": "stop", "then_s": 60.0, "ahead_m": 0.0}
    run = Run(cliff=cliff)
    on_edge = reading(contacts=int(Contact.CLIFF))
    assert run.go(0.4, range=on_edge) == []
    # The robot drives on, which makes the condition severe.
    run.go(0.02, range=on_edge)
    printed: list[Level] = []
    for count in range(10):
        printed += run.go(0.02, range=on_edge, encoders=Encoders(100 * count, 100 * count))
    assert printed == [Level.STOP]


def test_grave_is_never_less_than_the_first_reaction() -> None:
    battery = {"reaction": "pause", "then": "report", "after_s": 9.0, "empty_v": 12.0}
    run = Run(battery=battery)
    assert run.go(0.02, power=power(11.0)) == [Level.PAUSE]
    assert run.go(3.0, power=power(11.0)) == []


# ---- slow, pause, stop --------------------------------------------------------------------


def test_slow_lasts_as_long_as_its_cause_and_five_seconds() -> None:
    run = Run(stall=stall("slow", 0.0, "slow", 1.0))
    assert run.supervisor.factor == 1.0
    assert run.go(7.0, stalls=True) == [Level.SLOW]
    assert run.printed[0][1].factor == 0.5
    assert run.supervisor.factor == 0.5
    run.go(4.94)
    assert run.supervisor.factor == 0.5
    run.go(0.1)
    assert run.supervisor.factor == 1.0


def test_only_slow_has_a_factor() -> None:
    run = Run(stall=stall("report", 0.0, "pause", 0.5))
    run.go(1.0, stalls=True)
    assert [reaction.factor for _, reaction in run.printed] == [1.0, 1.0]
    assert run.supervisor.factor == 1.0


def test_a_pause_holds_until_a_person_ends_it() -> None:
    run = Run(stall=stall("pause", 0.0, "pause", 1.0))
    holding = [run.supervisor.holding]
    for seconds, stalls in ((0.1, True), (30.0, False)):
        run.go(seconds, stalls=stalls)
        holding.append(run.supervisor.holding)
    assert holding == [False, True, True], "a pause does not end by itself"
    run.supervisor.resume(run.time_s)
    assert not run.supervisor.holding
    assert run.go(0.1, stalls=True) == [Level.PAUSE], "after a resume, the rule reacts again"


def test_a_pause_without_an_answer_becomes_a_stop() -> None:
    run = Run(stall=stall("pause", 0.0, "pause", 1.0))
    run.go(0.1, stalls=True)
    paused_s = run.times[0]
    assert run.go(59.8) == []
    assert run.go(0.4) == [Level.STOP]
    at_s, reaction = run.printed[-1]
    assert reaction.kind == "pause"
    assert at_s - paused_s == pytest.approx(60.0, abs=0.05)
    assert not run.supervisor.holding
    assert run.go(100.0) == [], "there is one stop"


def test_a_second_pause_does_not_restart_the_time() -> None:
    run = Run(stall=stall("pause", 0.0, "pause", 1.0))
    run.go(0.1, stalls=True)
    run.go(40.0)
    assert run.go(0.1, stalls=True) == [Level.PAUSE], "this is a new occurrence"
    assert run.go(19.5) == []
    assert run.go(0.6) == [Level.STOP]


def test_the_gravest_comes_last() -> None:
    run = Run(
        lifted={"reaction": "stop"},
        stall=stall("report", 0.0, "report", 1.0),
        sensor={"reaction": "pause"},
    )
    bits = STALL | int(Fault.LIFTED | Fault.IMU)
    assert run.go(0.02, status=status(bits)) == [Level.REPORT, Level.PAUSE, Level.STOP]
    assert [reaction.kind for _, reaction in run.printed] == ["stall", "sensor", "lifted"]
    assert all(reaction.text and reaction.data for _, reaction in run.printed)


# ---- restart ------------------------------------------------------------------------------


def test_restart_resets_occasions_and_references() -> None:
    run = Run(stall=stall("report", 0.5, "stop", 1.0), bump={"count": 2.0, "after_s": 0.0})
    touch: list[Range] = [reading(contacts=1), reading()]
    run.go(0.4, stalls=True)
    run.go(0.02, range=touch[0], stalls=True)
    run.go(0.02, range=touch[1], stalls=True)
    run.supervisor.restart()
    assert run.go(0.48, stalls=True) == []
    run.go(0.02, range=reading(contacts=1))
    assert run.printed == [], "a restart discards the earlier bump and the earlier stall"


def test_a_gap_between_steps_resets_the_odometry() -> None:
    run = Run(slip={"reaction": "report", "after_s": 0.0})
    run.go(0.02, encoders=Encoders(0, 0))
    run.time_s += 0.29
    run.go(0.02, encoders=Encoders(0, 1000))
    assert run.printed == [], "the step took 0.31 s, so the motion is unknown"
    run.time_s += 0.2
    run.go(0.02, encoders=Encoders(0, 3000))
    assert len(run.printed) == 1, "in a step of 0.22 s, one wheel leads by 26 cm"


def test_a_gap_resets_the_slip() -> None:
    run = Run(slip={"reaction": "report", "after_s": 0.0, "then": "report"})
    for count in range(50):
        run.go(0.02, encoders=Encoders(0, 100 * count))
    assert len(run.printed) == 1
    run.time_s += 5.0
    run.go(2.0, encoders=Encoders(0, 4900))
    assert len(run.printed) == 1


def test_every_rule_is_evaluated() -> None:
    """Each rule reacts to its own cause."""
    causes: dict[str, dict[str, object]] = {
        "stall": {"status": status(STALL)},
        "lifted": {"status": status(int(Fault.LIFTED))},
        "sensor": {"status": status(int(Fault.IMU))},
        "battery": {"power": power(11.0)},
        "cliff": {"range": reading(contacts=int(Contact.CLIFF))},
        "fence": {"pose": Pose2(9.0, 0.0, 0.0)},
        "silence": {"last_frame_s": 1.0},
    }
    for kind, values in causes.items():
        extra = {"radius_m": 1.0} if kind == "fence" else {}
        run = Run(**{kind: {"reaction": "report", "after_s": 0.0, **extra}})
        run.go(0.02)
        run.go(0.02, **values)  # type: ignore[arg-type]  # values of messages
        assert [reaction.kind for _, reaction in run.printed] == [kind]
    run = Run(reset={"reaction": "report"})
    run.go(0.02, boot_id=1)
    run.go(0.02, boot_id=2)
    assert [reaction.kind for _, reaction in run.printed] == ["reset"]
    run = Run(disagreement={"reaction": "report"})
    run.go(0.3, planner=planner(7), onboard="paper")
    run.go(2.0, planner=planner(7), onboard="paper", yaw_rate_rad_s=1.0)
    assert [reaction.kind for _, reaction in run.printed] == ["disagreement"]
    run = Run(progress={"reaction": "report", "window_s": 1.0})
    run.go(1.1)
    assert [reaction.kind for _, reaction in run.printed] == ["progress"]
    run = Run(tilt={"reaction": "report", "after_s": 0.0})
    run.go(0.02, imu=imu(10_000, 0, 10_000))
    assert [reaction.kind for _, reaction in run.printed] == ["tilt"]
    run = Run(bump={"reaction": "report", "count": 1.0})
    run.go(0.02, range=reading(contacts=1))
    assert [reaction.kind for _, reaction in run.printed] == ["bump"]


def test_the_defaults_are_graded() -> None:
    rules = SuperviseSettings().rules
    assert len(rules) == 13
    assert {rule.reaction for rule in rules.values()} == set(Level) - {Level.OFF}
    with pytest.raises(ConfigError, match=r"supervise\.stall\.reaction"):
        settings_from({"stall": {"reaction": "loud"}})
    assert list(pairwise(sorted(Level))) == [
        (Level.OFF, Level.REPORT),
        (Level.REPORT, Level.SLOW),
        (Level.SLOW, Level.PAUSE),
        (Level.PAUSE, Level.STOP),
    ]


def test_a_robot_at_rest_is_left_in_peace() -> None:
    supervisor = Supervisor(MODEL)
    for step in range(100):
        time_s = 50.0 + STEP_S * step
        inputs = RuleInputs(
            *(time_s, Pose2(0.0, 0.0, 0.0), 0.0, 0.0, 1.0, time_s, 3, imu(mark=step)),
            *(Encoders(7, 7), reading(1.0), power(), status()),
        )
        assert supervisor.step(inputs) == []
    assert (supervisor.factor, supervisor.holding) == (1.0, False)


# ---- exactly at the limit: steps of 0.25 s add up exactly --------------------------------------


def quarters(run: Run, levels: str) -> list[str]:
    """Run one step for each character; ``x`` is a stall. Return the reactions of each step."""
    printed = []
    for stalls in levels:
        run.time_s += 0.25 - STEP_S
        printed.append("".join(level.name[0] for level in run.go(STEP_S, stalls=stalls == "x")))
    return printed


def test_a_calm_second_is_a_whole_one() -> None:
    run = Run(stall=stall("report", 0.0, "report", 1.0))
    run.time_s = 0.0
    assert quarters(run, "x...x") == ["R", "", "", "", ""], (
        "1 s after the stall, but calm for only 0.75 s"
    )
    assert quarters(run, "....x") == ["", "", "", "", "R"], "calm for 1 s"


def test_a_lasting_condition_is_answered_after_its_time() -> None:
    run = Run(stall=stall("report", 0.5, "stop", 0.75))
    run.time_s = 0.0
    assert quarters(run, "xxxxxxx") == ["", "", "R", "", "", "S", ""]


def test_a_pause_may_last_its_whole_limit() -> None:
    run = Run(stall=stall("pause", 0.0, "pause", 1.0), pause_limit_s=1.0)
    run.time_s = 0.0
    assert quarters(run, "x.....") == ["P", "", "", "", "", "S"]


def test_a_step_of_0_3_s_is_no_gap() -> None:
    """The right wheel leads by 26 cm. In a step longer than 0.3 s the motion is unknown."""
    for gap_s, printed in ((0.3, 1), (0.3001, 0)):
        supervisor = Supervisor(
            MODEL, settings_from({"slip": {"reaction": "report", "after_s": 0.0}})
        )
        for time_s, right in ((0.0, 0), (gap_s, 2000)):
            inputs = RuleInputs(
                *(time_s, Pose2(0.0, 0.0, 0.0), 0.0, 0.0),
                last_frame_s=time_s,
                encoders=Encoders(0, right),
            )
            found = supervisor.step(inputs)
        assert [reaction.kind for reaction in found] == ["slip"] * printed


def test_only_a_pause_holds() -> None:
    run = Run(stall=stall("report", 0.0, "stop", 0.5))
    assert run.go(1.0, stalls=True) == [Level.REPORT, Level.STOP]
    assert run.supervisor.holding is False


def test_the_graver_of_two_simultaneous_causes_is_last() -> None:
    run = Run(stall=stall("stop", 0.0, "stop", 1.0), sensor={"reaction": "report"})
    assert run.go(0.02, status=status(STALL | int(Fault.IMU))) == [Level.REPORT, Level.STOP]


def test_a_condition_that_persists_after_a_pause_is_answered_again() -> None:
    run = Run(stall=stall("pause", 0.0, "pause", 1.0))
    assert run.go(0.1, stalls=True) == [Level.PAUSE]
    run.supervisor.resume(run.time_s)
    assert run.go(0.1, stalls=True) == [Level.PAUSE]


def test_slow_driving_may_end_while_it_is_held() -> None:
    run = Run(stall=stall("slow", 0.0, "slow", 1.0))
    run.go(0.02, stalls=True)
    assert run.supervisor.factor == 0.5
    run.supervisor.resume(run.time_s + 4.9)
    assert run.supervisor.factor == 0.5
    run.supervisor.resume(run.time_s + 5.1)
    assert run.supervisor.factor == 1.0


def test_a_robot_that_was_moved_by_hand_has_not_slipped() -> None:
    for restarts, printed in ((False, 1), (True, 0)):
        run = Run(slip={"reaction": "report", "after_s": 0.0})
        run.go(0.02, encoders=Encoders(0, 0))
        if restarts:
            run.supervisor.restart()
        run.go(0.02, encoders=Encoders(0, 300))
        assert len(run.printed) == printed


def test_a_gap_ends_a_run_towards_an_echo() -> None:
    """A run of 0.5 m shows the slip; two runs of 0.25 m are too short."""
    for gap_s, printed in ((0.0, 1), (1.0, 0)):
        run = Run(slip={"reaction": "report", "after_s": 0.0, "then": "report"})
        count = 0
        for step in range(124):
            if step == 62:
                run.time_s += gap_s
            count += 31
            path_m = count * 3.141592653589793 * 0.065 / 1560
            ahead = reading(2.0 - 0.5 * path_m)
            run.go(0.02, encoders=Encoders(count, count), range=ahead)
        assert len(run.printed) == printed


# ---- plug-ins -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Touched(PluggedRule):
    """A bumper switch is pressed; both pressed is too much for the condition."""

    def condition(self, model: RobotModel) -> object:
        assert model is MODEL
        return TouchedCondition()


class TouchedCondition:
    grave = False

    def holds(self, inputs: RuleInputs, _measured: object) -> bool:
        contacts = 0 if inputs.range is None else inputs.range.contacts
        if contacts == Contact.BUMPER_LEFT | Contact.BUMPER_RIGHT:
            raise ValueError("both switches")
        return contacts != 0

    def evidence(self) -> tuple[str, dict[str, object]]:
        return "touched", {"switch": "left"}

    def restart(self) -> None:
        """Keep nothing from before."""


def with_plugged_rule() -> Run:
    run = Run()
    rule = Touched(reaction=Level.STOP, after_s=0.0)
    added = [("touched", Touched, field(default=rule))]
    kind = make_dataclass("WithTouched", added, bases=(SuperviseSettings,), frozen=True)
    settings = kind(**run.supervisor.settings.rules)
    assert isinstance(settings, SuperviseSettings)
    run.supervisor = Supervisor(MODEL, settings)
    return run


def test_the_rule_of_a_plug_in_reacts_like_any_other() -> None:
    run = with_plugged_rule()
    assert run.go(0.1, range=reading()) == []
    assert run.go(0.02, range=reading(contacts=int(Contact.BUMPER_LEFT))) == [Level.STOP]
    (_, reaction) = run.printed[0]
    assert (reaction.kind, reaction.text, reaction.data) == (
        "touched",
        "touched",
        {"switch": "left"},
    )


def test_the_failure_of_a_plug_in_is_reported_once() -> None:
    run = with_plugged_rule()
    both = reading(contacts=int(Contact.BUMPER_LEFT | Contact.BUMPER_RIGHT))
    assert run.go(0.1, range=both) == [Level.REPORT]
    (_, reaction) = run.printed[0]
    assert reaction.kind == "touched"
    assert "both switches" in reaction.text
    assert reaction.data == {}


def test_a_gap_does_not_forget_how_far_the_robot_drove_on_at_a_cliff() -> None:
    rule = {"reaction": "report", "after_s": 0.0, "then": "stop", "then_s": 60.0}
    run = Run(cliff={**rule, "ahead_m": 0.05})
    counts = itertools.count(step=round(0.004 / MODEL.metres_per_count))

    def drive(seconds: float, contacts: int) -> list[Level]:
        return [
            level
            for _ in range(round(seconds / STEP_S))
            for level in run.go(
                STEP_S, encoders=Encoders(*[next(counts)] * 2), range=reading(contacts=contacts)
            )
        ]

    drive(2.0, 0)
    assert drive(0.1, int(Contact.CLIFF)) == [Level.REPORT]
    run.time_s += 0.4
    assert Level.STOP in drive(0.6, int(Contact.CLIFF))
