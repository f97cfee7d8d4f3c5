"""``simulate`` with faults: they are logged and repeatable, and the run ends correctly."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import pytest

from support.cli import decoded, plain_messages, sweepctl
from tools.virtual.run import EPOCH_NS

if TYPE_CHECKING:
    from pathlib import Path

    from support.processes import Done


pytestmark = pytest.mark.usefixtures("target")


def simulate(log: Path, *arguments: str, max_time_s: float = 6.0) -> Done:
    command = ("simulate", "case-1", "--planner", "paper", "--json", "--out", log)
    return sweepctl(*command, "--max-time", str(max_time_s), *arguments)


def faults(log: Path) -> list[tuple[float, str, str]]:
    """Return each fault event: time since boot, beginning or end, and text."""
    found: list[tuple[float, str, str]] = []
    for plain, event in decoded(log, "/events"):
        if event.source == "fault":
            found.append(((plain.log_ns - EPOCH_NS) / 1e9, event.kind, event.text))
    return found


def test_injected_faults_are_logged(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    done = simulate(
        log, "--fault", "bit-flips@3:1:rate=0.01", "--fault", "wheel-slip@4.5:0.25:left"
    )
    assert done.status == 1, "the time was too short, and nothing else"
    assert done.json["outcome"] == "timeout"
    assert done.json["wire"]["crc_errors"] > 5
    flips, slip = "bit-flips@3:1:rate=0.01,way=both", "wheel-slip@4.5:0.25:side=left,share=0.3"
    assert faults(log) == [
        (3.0, "began", f"bit-flips began ({flips})"),
        (4.0, "ended", f"bit-flips ended ({flips})"),
        (4.5, "began", f"wheel-slip began ({slip})"),
        (4.75, "ended", f"wheel-slip ended ({slip})"),
    ]


@pytest.mark.parametrize(
    ("fault", "status", "outcome", "reason"),
    [
        ("unplug@4", 3, "fault", "the device was lost for 30 s"),
        ("unplug@4:3", 5, "stopped", "the device was lost and is back"),
        ("reset@4", 5, "stopped", "the device was lost and is back"),
        ("unplug@0", 3, "fault", "nothing received"),
    ],
)
def test_a_device_that_is_lost(
    tmp_path: Path, fault: str, status: int, outcome: str, reason: str
) -> None:
    log = tmp_path / "run.mcap"
    done = simulate(log, "--fault", fault, max_time_s=60.0)
    assert (done.status, done.json["outcome"]) == (status, outcome)
    assert reason in done.json["reason"]
    assert faults(log)[0][2].startswith(fault.split("@", maxsplit=1)[0])


def test_the_same_seed_and_faults_give_the_same_log(tmp_path: Path) -> None:
    storm = (
        *("--fault", "byte-loss@3:rate=0.001", "--fault", "jitter@3:ms=5"),
        *("--fault", "person@3.5:1", "--baud", "230400", "--latency-ms", "16"),
    )
    logs: list[Any] = []
    for name, seed in (("one", "3"), ("two", "3"), ("three", "4")):
        simulate(tmp_path / name, "--seed", seed, *storm, max_time_s=2.0)
        logs.append(plain_messages(tmp_path / name))
    assert logs[0] == logs[1]
    assert logs[0] != logs[2]


def test_a_fault_after_the_end_changes_nothing(tmp_path: Path) -> None:
    simulate(tmp_path / "bare", max_time_s=2.0)
    simulate(tmp_path / "late", "--fault", "person@9999", max_time_s=2.0)
    assert plain_messages(tmp_path / "bare") == plain_messages(tmp_path / "late")


def test_the_truth_is_logged_with_a_drifting_clock(tmp_path: Path) -> None:
    check_truth(tmp_path, "clock-drift@1:ppm=500")


@pytest.mark.python_only("the chip has one counter, which does not jump")
def test_the_truth_is_logged_with_a_clock_that_jumps(tmp_path: Path) -> None:
    check_truth(tmp_path, "clock-jump@3:ms=-50")


def check_truth(tmp_path: Path, fault: str) -> None:
    """Check that true poses are logged, and that the estimate is compared at the true time."""
    log = tmp_path / "run.mcap"
    reported = simulate(log, "--fault", fault, max_time_s=8.0).json
    stamps = [plain.log_ns - EPOCH_NS for plain, _ in decoded(log, "/truth/pose")]
    gaps_ms = {(later - earlier) // 1_000_000 for earlier, later in pairwise(stamps)}
    # A true pose comes every 40 ms, with a delay of less than a control period (10 ms).
    assert gaps_ms <= set(range(30, 51))
    # The log covers the whole path. No true pose is compared with an estimate of another time: 50
    # ms at 0.2 m/s would be 10 mm. The drive is straight, and its scale is known to half a percent.
    assert reported["path_m"] > 0.4
    assert reported["pose_error_m"]["max"] < 0.01


def test_a_sensor_that_the_robot_lacks_is_not_reported_as_broken(tmp_path: Path) -> None:
    robot = tmp_path / "blind.toml"
    robot.write_text("[ultrasonic]\nfitted = false\n")
    options = ("--robot", str(robot), "--supervise-rule", "sensor.reaction=stop")
    done = sweepctl(
        "simulate",
        "case-1",
        "--json",
        *options,
        "--max-time",
        "40",
        "--out",
        str(tmp_path / "run.mcap"),
    )
    assert done.json["collisions"] >= 2, "contacts that an ultrasonic sensor would have seen"
    assert (done.json["outcome"], done.status) == ("timeout", 1), done.json["reason"]
