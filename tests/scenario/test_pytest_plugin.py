"""The pytest plugin as users run it: in their own pytest, in their own folder."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.metadata import entry_points
from typing import TYPE_CHECKING

import pytest

from bridge.record.reader import LogReader
from support.root import ROOT

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


pytestmark = pytest.mark.realtime

INSTALLED = bool(entry_points(group="pytest11", name="sweepctl"))
"""Whether pytest finds the plugin by itself, as in an installation."""


def users_pytest(
    pytester: pytest.Pytester,
    monkeypatch: pytest.MonkeyPatch,
    *arguments: str,
    python_path: str = str(ROOT),
) -> pytest.RunResult:
    """Run pytest in the user's folder, with the plugin and without this project's settings."""
    monkeypatch.setenv("PYTHONPATH", python_path)
    plugin = () if INSTALLED else ("-p", "sweepctl_pytest")
    return pytester.runpytest_subprocess(*plugin, "-p", "no:cacheprovider", *arguments)


FIXTURES = """
import pytest

FINAL = {}

@pytest.mark.sweeper(room="empty", noise="none", node=3)
def test_a_velocity_is_followed(sweeper):
    assert sweeper.connected and sweeper.host.session.node == 3
    x_m = sweeper.truth.pose.x_m
    sweeper.enable()
    sweeper.drive(0.1, 0.0, for_s=5.0)
    sweeper.run(1.0)
    # 0.5 m, less 5 mm for the acceleration to 0.1 m/s at 1 m/s2, plus the path until the last
    # setpoint expires.
    assert sweeper.truth.pose.x_m - x_m == pytest.approx(0.5, abs=0.04)
    assert sweeper.pose_error_m < 0.01
    assert abs(sweeper.truth.v_m_s) < 1e-3
    assert sweeper.imu.latest.accel_z_m_s2 == pytest.approx(9.81, abs=0.3)
    assert sweeper.range.latest is not None and sweeper.power.latest is not None

@pytest.mark.sweeper(room="empty", noise="none")
def test_a_velocity_expires(sweeper):
    sweeper.enable()
    sweeper.drive(0.1, 0.0)
    sweeper.run(3.0)
    assert 0.03 < sweeper.truth.path_m < 0.1  # it drives for 0.5 s
    sweeper.stop()
    assert sweeper.stop_cause.name == "OPERATOR"
    with pytest.raises(Exception, match="stopped by the test"):
        sweeper.drive(0.1, 0.0)
    with pytest.raises(Exception, match="clear_stop=True"):
        sweeper.enable()
    sweeper.enable(clear_stop=True)

@pytest.mark.sweeper(noise="typical", seed=5)
class TestSeeds:
    def drive(self, sweeper):
        sweeper.enable()
        sweeper.drive(0.1, 0.3, for_s=1.0)
        return tuple(sweeper.truth.pose)

    @pytest.mark.sweeper(room="empty")
    def test_one(self, sweeper):
        FINAL["one"] = self.drive(sweeper)

    @pytest.mark.sweeper(room="empty")
    def test_the_same(self, sweeper):
        assert self.drive(sweeper) == FINAL["one"]

    @pytest.mark.sweeper(room="empty", seed=6)
    def test_another(self, sweeper):
        assert self.drive(sweeper) != FINAL["one"]

@pytest.mark.sweeper(room="empty", noise="none", faults=["wheel-stuck@0:side=right"])
def test_a_fault_from_the_start(sweeper):
    sweeper.enable()
    sweeper.drive(0.1, 0.0, for_s=1.5)
    assert sweeper.active_faults == ["wheel-stuck@0:side=right"]
    assert abs(sweeper.truth.right_rad) < 0.1 < sweeper.truth.left_rad
    sweeper.clear_faults()
    assert sweeper.active_faults == []

@pytest.mark.sweeper(room="empty", noise="none", link="slcan")
def test_a_fault_while_it_runs(sweeper):
    sweeper.run(0.5)
    assert sweeper.range.latest.ultrasonic_m is not None
    sweeper.fault("ultrasonic-blind")
    sweeper.run(0.5)
    assert sweeper.range.latest.ultrasonic_m is None
    sweeper.clear_faults("ultrasonic-blind")
    sweeper.run(0.5)
    assert sweeper.range.latest.ultrasonic_m is not None

@pytest.mark.sweeper(room="empty", noise="none")
def test_a_plan(sweeper):
    summary = sweeper.clean("u-shape", max_time_s=15.0)
    assert summary["outcome"] == "timeout"
    assert 8.0 < summary["duration_s"] < 15.0
    assert summary["path_m"] > 1.0
    assert summary["pose_error_m"]["max"] < 0.05
    assert summary["coverage"]["mouth_sweepable"] > 0.02
"""


def test_the_sweeper_fixture(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    pytester.makepyfile(FIXTURES)
    result = users_pytest(pytester, monkeypatch, "--strict-markers", "-W", "error")
    result.assert_outcomes(passed=8)


PORT = """
import os
import pytest
import bridge

PORTS = []

@pytest.mark.sweeper(room="empty", noise="none", node=5)
def test_a_pty(sweeper_port):
    PORTS.append(sweeper_port)
    assert os.path.exists(sweeper_port)
    with bridge.open(sweeper_port) as robot:
        assert robot.host.session.node == 5

def test_it_is_gone():
    assert not os.path.exists(PORTS[0])

@pytest.mark.sweeper(room="empty", noise="none", link="tcp")
def test_a_socket(sweeper_port):
    assert sweeper_port.startswith("socket://127.0.0.1:")
    with bridge.open(sweeper_port) as robot:
        assert robot.status is not None
"""


def test_the_port_fixture_beside_a_folder_named_like_ours(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The emulator uses our `tools`, whatever the tests' folder contains."""
    pytester.mkdir("tools").joinpath("sweepctl.py").write_text("raise SystemExit('not ours')")
    pytester.makepyfile(PORT)
    users_pytest(pytester, monkeypatch, "-W", "error").assert_outcomes(passed=3)


WRONG = {
    "room": ('room="no-such-room"', "no room 'no-such-room': give a file or one of"),
    "noise": ('noise="loud"', "loud"),
    "fault": ('faults=["gremlins@3"]', "there is no kind 'gremlins'"),
    "key": ('rooom="empty"', "no 'rooom'; there are room, noise, seed, faults, node, link"),
    "kind": ('seed="one"', "seed='one' is not int"),
    "link": ('link="wifi"', "link 'wifi' is not one of pty, tcp, slcan, udpcan"),
    "node": ("node=99", "node=99 is not in 1 to 15"),
    "seed": ("seed=-1", "seed=-1 is not in 0 to 9223372036854775807"),
    "number": ("faults=[5]", "faults=[5] is no list of str"),
    "word": ('"empty"', "write name=value"),
}


def test_an_error_is_one_line(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    for fixture in ("sweeper", "sweeper_port"):
        cases = "\n".join(
            f"@pytest.mark.sweeper({argument})\ndef test_{name}({fixture}): pass\n"
            for name, (argument, _) in WRONG.items()
            if fixture == "sweeper" or name in {"room", "fault"}
        )
        pytester.makepyfile(**{f"test_{fixture}": f"import pytest\n{cases}"})
    result = users_pytest(pytester, monkeypatch, "-rE")
    result.assert_outcomes(errors=len(WRONG) + 2)
    out = result.stdout.str()
    assert "Traceback" not in out
    for name, (_, expected) in WRONG.items():
        printed = [line for line in out.splitlines() if f"::test_{name} - " in line]
        assert printed, name
        block = "\n".join(_setups(out, f"test_{name}"))
        assert expected in block, f"{name}: {block}"


def _setups(out: str, test: str) -> Sequence[str]:
    """Return the output about a test's setup, without headings."""
    return re.findall(rf"ERROR at setup of {test} _+\n(.*?)\n(?:_|=)", out, re.DOTALL)


def test_pytest_starts_as_quickly_as_without(tmp_path: Path) -> None:
    program = (
        "import sys, sweepctl_pytest\n"
        "heavy = {'numpy', 'scipy', 'serial', 'can', 'click', 'protocol', 'bridge', "
        "'sim_device'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "[]\n"


def test_a_package_of_the_users_own_may_be_called_tools(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their tests run; a fixture, which needs our package, fails with one line."""
    folder = pytester.mkpydir("tools")
    (folder / "mine.py").write_text("ANSWER = 42\n")
    pytester.makepyfile(
        test_mine="from tools.mine import ANSWER\n\ndef test_mine():\n    assert ANSWER == 42\n"
        "\ndef test_needs_ours(sweeper):\n    pass\n"
    )
    pytester.syspathinsert()
    users_path = os.pathsep.join([str(pytester.path), str(ROOT)])
    result = users_pytest(pytester, monkeypatch, python_path=users_path)
    result.assert_outcomes(passed=1, errors=1)
    assert "Traceback" not in result.stdout.str()
    result.stdout.fnmatch_lines(["sweepctl's package 'tools' is hidden by another of that name: *"])


def test_the_plugin_has_no_effect_without_its_fixtures(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The user's own option --port stays in effect."""
    pytester.makeconftest("def pytest_addoption(parser):\n    parser.addoption('--port')\n")
    pytester.makepyfile("def test_it(pytestconfig): assert pytestconfig.getoption('port') == '.'")
    result = users_pytest(pytester, monkeypatch, "--port", ".")
    result.assert_outcomes(passed=1)


RECORDED = """
import pytest

@pytest.mark.sweeper(record=True, room="empty", seed=3, faults=["wheel-slip@4:1:share=0.5"])
@pytest.mark.parametrize("metres", [0.1, 9.0])
def test_distance(sweeper, metres):
    sweeper.enable()
    sweeper.drive(0.1, 0.0, for_s=2.0)
    assert sweeper.truth.path_m > metres

@pytest.mark.sweeper(record=True)
def test_port(sweeper_port):
    import bridge
    with bridge.open(sweeper_port) as robot:
        robot.wait_for_link()
    assert sweeper_port == ""

@pytest.fixture
def broken(sweeper):
    raise ValueError("a fixture of the user")

@pytest.mark.sweeper(record=True)
def test_setup(broken):
    pass

@pytest.mark.sweeper(record=False)
def test_not_recorded(sweeper):
    assert False
"""


def test_the_log_of_a_failed_test_is_kept_and_named(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytester.makepyfile(test_recorded=RECORDED)
    result = users_pytest(pytester, monkeypatch)
    result.assert_outcomes(passed=1, failed=3, errors=1)
    kept = sorted(path.name for path in (pytester.path / "runs").iterdir())
    assert kept == [
        "test_recorded.py-test_distance-9.0.mcap",
        "test_recorded.py-test_port.mcap",
        "test_recorded.py-test_setup.mcap",
    ]
    named = re.findall(r"sweepctl report (\S+)", result.stdout.str())
    assert sorted(named) == [str(pytester.path / "runs" / name) for name in kept]
    log = pytester.path / "runs" / kept[0]
    reader = LogReader(log)
    assert (reader.truncated, reader.run["faults"]) == (False, "wheel-slip@4:1:share=0.5")
    assert reader.summary is not None
    assert reader.summary["path_m"] == pytest.approx(0.2, abs=0.05)
    topics = {message.topic for message in reader.messages()}
    assert {"/truth/pose", "/raw/uart/rx", "/device/imu", "/events", "/pose"} <= topics
    sources = {m.decoded.source for m in reader.messages({"/events"})}
    assert "fault" in sources
    truth = {message.topic for message in LogReader(pytester.path / "runs" / kept[1]).messages()}
    assert "/truth/pose" in truth


def test_record_is_true_or_false(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytester.makepyfile(
        "import pytest\n@pytest.mark.sweeper(record='x')\ndef test_x(sweeper):\n    pass\n"
    )
    result = users_pytest(pytester, monkeypatch)
    result.stdout.fnmatch_lines(["*sweeper: record='x' is neither True nor False"])
