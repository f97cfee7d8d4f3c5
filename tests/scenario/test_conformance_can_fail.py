"""The device conformance suite as users run it, on correct and on defective devices."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from concurrent.futures import Future, ThreadPoolExecutor
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

from sim_device.ports import ask_control
from support.broken_device import DEFECTS, KEY, STATES, Keyed
from support.root import ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.realtime

ENVIRONMENT = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}"}

INSTALLED = bool(entry_points(group="pytest11", name="sweepctl"))
"""Whether pytest finds the project's plugin by itself."""

AT_ONCE = 4

FOUND_BY = {
    "wrongchain": {"test_describe_matches_the_catalogue"},
    "rarehello": {"test_hello_once_a_second_until_the_handshake"},
    "executesrepeats": {"test_a_repeated_command_is_answered_but_not_executed_again"},
    "dropslatch": {"test_a_stop_is_latched_and_leaves_every_mode"},
    "stampslate": {"test_stamps_advance_and_are_of_the_sampling"},
    "lossy": {"test_sequence_numbers_count_every_frame"},
    "driveson": {"test_an_expired_setpoint_ramps_to_rest_and_does_not_latch"},
    "ignorescrc": {"test_a_damaged_frame_is_counted_and_not_obeyed"},
    "transmitonly": {"test_a_silent_host_is_a_lost_link"},
    "obeysothernodes": {"test_another_nodes_messages_are_ignored"},
    "obeysnodeall": {"test_node_0_is_for_stop_hello_and_time_alone"},
    "latchesnewest": {"test_the_graver_of_two_stops_that_coincide_is_latched"},
    "savesnothing": {"test_saved_values_survive_a_reboot_and_others_do_not"},
    "ignoresstopall": {
        "test_a_stop_of_every_device_is_latched_as_the_operators",
        "test_a_stop_of_every_device_is_answered_outside_a_session",
    },
    "ignoresbootid": {"test_a_hello_of_another_boot_opens_no_session"},
    "keepsdriverson": {"test_the_drivers_are_disabled_at_rest"},
    "falsereversal": {"test_encoders_that_agree_with_their_motors_are_no_fault"},
    "ignorescliff": {"test_at_a_cliff_it_does_not_go_ahead"},
    "ignoresbumper": {"test_with_a_bumper_pressed_it_creeps"},
    "ackssaveearly": {"test_a_save_is_acknowledged_once_it_stands"},
    "impreciseclock": {"test_its_clock_is_a_crystals_or_it_reports_that_it_is_not"},
    "hidescrash": {"test_a_crash_comes_with_its_record"},
    "obeysunsignedcommands": {"test_an_unsigned_command_is_rejected"},
    "obeysunsignedsetpoints": {"test_an_unsigned_setpoint_moves_nothing"},
    "ignorestags": {"test_a_command_with_another_key_is_not_obeyed"},
    "obeysreplays": {"test_a_replayed_command_is_not_obeyed"},
    "obeysearliersessions": {"test_a_command_of_an_earlier_session_is_not_obeyed"},
    "weakensunsignedstop": {"test_a_stop_needs_no_tag"},
}
"""Checks that must fail for each defect."""
IN_STATE = {
    "atcliff": "test_at_a_cliff_it_does_not_go_ahead",
    "pressed": "test_with_a_bumper_pressed_it_creeps",
    "crashed": "test_a_crash_comes_with_its_record",
    "keyed": "test_a_signed_command_is_obeyed",
}
"""Check that applies only in the state of each of these devices, which have no defect."""
SOUND = (
    "test_hello_identifies_the_device",
    "test_an_answer_names_the_command",
    "test_lone_zeros_are_no_error",
)
"""Checks that must pass on each device without a defect."""


class Outcome(NamedTuple):
    """Result of a run of the suite."""

    status: int
    out: str
    report: dict[str, Any]

    def of(self, outcome: str) -> set[str]:
        return {
            c["check"].partition("[")[0] for c in self.report["checks"] if c["outcome"] == outcome
        }


def conformance(folder: Path, *arguments: str) -> Outcome:
    """Run ``pytest`` with these arguments at the project's root."""
    report = folder / "report.json"
    done = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"),
            *("--conformance-report", str(report), *arguments),
        ],
        cwd=ROOT,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )
    found = json.loads(report.read_text()) if report.exists() else {}
    return Outcome(done.returncode, done.stdout + done.stderr, found)


@pytest.fixture(scope="module", name="runs")
def _runs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Future[Outcome]]]:
    """Run the suite on several devices in parallel, because the checks mostly wait."""
    names = ["sound", *FOUND_BY, *IN_STATE]
    key_file = tmp_path_factory.mktemp("key") / "robot.key"
    key_file.touch(mode=0o600)
    key_file.write_text(KEY.hex(), encoding="ascii")
    with (
        subprocess.Popen(
            [sys.executable, "-m", "support.broken_device", *names],
            cwd=ROOT,
            env=ENVIRONMENT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        ) as devices,
        ThreadPoolExecutor(AT_ONCE) as pool,
    ):
        assert devices.stdout is not None
        assert devices.stdin is not None
        futures = {}
        for name in names:
            port = devices.stdout.readline().removeprefix("ready ").strip()
            checks = [*SOUND, *FOUND_BY.get(name, ())]
            if name in IN_STATE:
                checks.append(IN_STATE[name])
            arguments = [f"--port={port}", "-k", " or ".join(checks)]
            if issubclass(DEFECTS[name], Keyed):
                arguments.append(f"--key-file={key_file}")
            if name != "sound":
                arguments.append("--allow-motion")
            else:
                arguments[-1] += " or test_it_follows_a_setpoint or test_its_state_is_reported"
            futures[name] = pool.submit(conformance, tmp_path_factory.mktemp(name), *arguments)
        yield futures
        for future in futures.values():
            future.exception()
        devices.stdin.close()
        assert devices.wait(30) == 0


def test_every_defect_has_its_check() -> None:
    assert FOUND_BY.keys() == DEFECTS.keys() - {"sound", *STATES}
    assert IN_STATE.keys() == set(STATES)


@pytest.mark.parametrize("state", IN_STATE)
def test_a_sound_device_passes_the_check_that_needs_its_state(
    state: str, runs: dict[str, Future[Outcome]]
) -> None:
    outcome = runs[state].result()
    assert outcome.status == 0, outcome.out
    assert outcome.of("passed") == {*SOUND, IN_STATE[state]}, outcome.out


@pytest.mark.parametrize("defect", FOUND_BY)
def test_a_defect_is_found_by_the_check_for_it(
    defect: str, runs: dict[str, Future[Outcome]]
) -> None:
    outcome = runs[defect].result()
    assert outcome.of("failed") == FOUND_BY[defect], outcome.out
    assert outcome.of("passed") == set(SOUND), outcome.out
    assert outcome.status == 1
    assert outcome.report["passed"] is False


def test_a_sound_device_passes(runs: dict[str, Future[Outcome]]) -> None:
    outcome = runs["sound"].result()
    assert outcome.status == 0, outcome.out
    report = outcome.report
    assert report["passed"] is True
    assert outcome.of("passed") >= set(SOUND)
    assert outcome.of("failed") == set()
    assert "test_it_follows_a_setpoint" in outcome.of("not_run"), "nobody allowed motion"
    assert report["device"]["node"] == 1
    assert len(bytes.fromhex(report["device"]["uid"])) == 12
    assert report["chapters"]["Handshake"]["passed"] == 1
    assert "moving checks were off" in outcome.out
    assert "--allow-motion" in outcome.out
    assert "Handshake" in outcome.out


@pytest.mark.parametrize(
    ("port", "why"),
    [
        ("/dev/no-such-robot", "does not exist; plug in the robot"),
        (
            "can:nothing",
            "is not a CAN port: use can:INTERFACE:CHANNEL, for example can:socketcan:can0",
        ),
    ],
)
def test_a_port_that_cannot_be_opened_is_one_line(tmp_path: Path, port: str, why: str) -> None:
    outcome = conformance(tmp_path, f"--port={port}")
    assert outcome.status == 4
    assert outcome.out.strip().splitlines() == [f"ERROR: {port} {why}"]


def test_a_device_that_dies_on_the_way_ends_the_run_with_one_line(tmp_path: Path) -> None:
    emulate = [sys.executable, "-m", "tools.sweepctl", "emulate", "empty", "--control"]
    control = tmp_path / "sweeper.ctl"
    with subprocess.Popen([*emulate, control], cwd=ROOT, stdout=subprocess.PIPE, text=True) as fake:
        assert fake.stdout is not None
        port = fake.stdout.readline().removeprefix("ready ").strip()
        with ThreadPoolExecutor(1) as pool:
            running = pool.submit(conformance, tmp_path, f"--port={port}")
            # The device rejects commands in its first session, so that a check is in progress.
            while not _in_session(control):
                time.sleep(0.05)
            fake.terminate()
            outcome = running.result()
        assert fake.wait(30) == 0
    assert outcome.status == 4
    assert "the device was lost during test_" in outcome.out
    assert len(outcome.of("failed")) == 1
    assert outcome.report["passed"] is False


def _in_session(control: Path) -> bool:
    """Return whether a host has written many bytes to the device."""
    counts = ask_control(control, "line")
    return bool(counts["line"]["from_host"] > 500)


def test_a_port_without_an_answer_is_one_line(tmp_path: Path) -> None:
    """The port is given as users type it: an existing path as a separate word."""
    master, slave = os.openpty()
    plugin = [] if INSTALLED else ["-p", "sweepctl_pytest"]
    try:
        outcome = conformance(tmp_path, *plugin, "--port", os.ttyname(slave))
    finally:
        os.close(master)
        os.close(slave)
    assert outcome.status == 4
    (line,) = outcome.out.strip().splitlines()
    assert "nothing answers a hello" in line
