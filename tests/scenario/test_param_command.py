"""``sweepctl param`` on a virtual sweeper, with a free port and with an owned port."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

import bridge
from bridge.motion.robot_model import RobotModel
from support.cli import sweepctl
from support.served import Served
from tools.cli.keyfile import make_key

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from support.processes import Done

pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("target")]

DEFAULTS = RobotModel()


@pytest.fixture
def served() -> Iterator[Served]:
    with Served() as served:
        yield served


@pytest.fixture(params=["free", "owned"])
def port(request: pytest.FixtureRequest, served: Served) -> Iterator[str]:
    """Return the device's port, with and without a process that owns it."""
    if request.param == "free":
        yield served.port
        return
    with bridge.open(served.port):
        yield served.port


def param(*arguments: str | Path) -> Done:
    return sweepctl("param", *arguments)


def test_list_get_set_save(port: str, served: Served) -> None:
    listed = param("list", port, "--json")
    assert listed.status == 0
    by_name = {p["name"]: p for p in listed.json["parameters"]}
    base = by_name["wheel_base"]
    assert (base["unit"], base["kind"], base["needs_reboot"]) == ("m", "f32", True)
    assert base["low"] == pytest.approx(0.02)
    assert base["high"] == pytest.approx(2.0)
    assert by_name["node"]["read_only"] is True

    assert param("set", port, "cruise_speed", "0.15", "battery_low", "13").status == 0
    assert param("get", port, "cruise_speed", "battery_low").out == "0.15\n13\n"
    assert served.parameter("cruise_speed") == pytest.approx(0.15)
    found = param("get", port, "cruise_speed", "--json").json["parameters"][0]
    assert (found["changed"], found["stored"]) == (True, False)
    saved = param("save", port)
    assert saved.status == 0
    assert "cruise_speed" in saved.err
    found = param("get", port, "cruise_speed", "--json").json["parameters"][0]
    assert (found["changed"], found["stored"]) == (False, True)
    back = ("cruise_speed", str(DEFAULTS.cruise_speed_m_s), "battery_low", "12.8")
    done = param("set", port, *back, "--save")
    assert done.status == 0
    assert "cruise_speed: 0.15 -> 0.2 m/s" in done.err


def test_a_rejection_reports_its_reason(port: str, served: Served) -> None:
    before = served.parameter("max_speed")
    too_fast = param("set", port, "max_yaw_rate", "1.5", "max_speed", "50")
    assert too_fast.status == 2
    assert too_fast.line == "sweepctl: max_speed: 50 is not in 0.01 to 2 m/s"
    assert served.parameter("max_speed") == before
    assert served.parameter("max_yaw_rate") == DEFAULTS.max_yaw_rate_rad_s, "all or nothing"
    assert "read-only" in param("set", port, "node", "3").line
    unknown = param("get", port, "wheel_bas")
    assert unknown.status == 2
    assert "did you mean wheel_base?" in unknown.line
    assert param("set", port, "wheel_base").status == 2
    twice = param("set", port, "wheel_base", "0.231", "wheel_base", "0.232")
    assert (twice.status, "wheel_base is given twice" in twice.line) == (2, True)
    below = param("set", port, "max_speed", "-0.01")
    assert "max_speed: -0.01 is not in" in below.line
    assert "is not a number" in param("set", port, "wheel_base", "wide").line


def test_diff_with_a_robot_file(port: str, tmp_path: Path) -> None:
    file = tmp_path / "robot.toml"
    file.write_text("")
    same = param("diff", port, file)
    assert (same.status, same.out) == (0, "")
    file.write_text("wheel_base_m = 0.25\n")
    other = param("diff", port, file, "--json")
    assert other.status == 1
    difference = other.json["differences"]
    assert [(d["name"], d["unit"], d["file"]) for d in difference] == [("wheel_base", "m", 0.25)]
    assert difference[0]["device"] == pytest.approx(0.23)
    assert "wheel_base" in param("diff", port, file).out
    file.write_text("wheel_base = 1\n")
    assert param("diff", port, file).status == 2


def test_a_table_for_people(port: str) -> None:
    lines = param("list", port).out.splitlines()
    assert " ".join(lines[0].split()) == (
        "no parameter value unit type range default effective state"
    )
    row = next(line for line in lines if " wheel_diameter " in line)
    assert row.split()[1:6] == ["wheel_diameter", "0.065", "m", "f32", "0.01"]
    assert "  after reboot" in row
    assert "needs" not in row, "nothing of it was changed"
    assert "  at once" in next(line for line in lines if " max_speed " in line)


def test_a_value_that_a_reboot_would_undo_reports_what_it_needs(port: str) -> None:
    present = param("get", port, "infrared_left_scale").out.strip()
    value = "1.03" if present == "1.02" else "1.02"

    def row(name: str) -> str:
        lines = param("list", port).out.splitlines()
        return next(line for line in lines if f" {name} " in line)

    reported = param("set", port, "infrared_left_scale", value)
    assert "next boot; save, then reboot the device" in reported.err
    assert row("infrared_left_scale").endswith("after reboot  needs save and reboot")
    assert "needs" not in row("infrared_right_scale")
    assert "infrared_left_scale: takes effect at the next boot; reboot the device" in (
        param("save", port).err
    )
    assert row("infrared_left_scale").endswith("after reboot  stored")


def test_reset_returns_to_the_devices_own_defaults(port: str, served: Served) -> None:
    value = served.parameter
    assert param("set", port, "cruise_speed", "0.15", "battery_low", "13").status == 0
    done = param("reset", port, "cruise_speed")
    assert (done.status, done.err.splitlines()[0]) == (0, "cruise_speed: 0.15 -> 0.2 m/s")
    assert value("cruise_speed") == pytest.approx(0.2)
    assert value("battery_low") == pytest.approx(13.0)
    reset = param("reset", port, "--all", "--save", "--json")
    assert "battery_low" in [p["name"] for p in reset.json["parameters"]]
    listed = param("list", port, "--changed", "--json").json["parameters"]
    assert [p["name"] for p in listed if not p["read_only"]] == []
    assert "nothing was changed" in param("reset", port, "--all").err
    for wrong in ((), ("--all", "cruise_speed")):
        assert "give the NAMEs of parameters, or --all" in param("reset", port, *wrong).line
    assert value("node") == 1


def test_no_such_port() -> None:
    assert param("list", "/dev/none-such").status == 3
    done = param("list", "/dev/none-such", "--json")
    assert json.loads(done.out)["exit_status"] == 3


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (("param", "set", "PORT", "cruise_speed", "0.15"), "get parameter"),
        (("reboot", "PORT"), "reboot"),
        (("key", "PORT", "--clear"), "set key"),
    ],
)
def test_a_wrong_key_is_reported(
    served: Served, tmp_path: Path, words: tuple[str, ...], what: str
) -> None:
    right, wrong = tmp_path / "right.key", tmp_path / "wrong.key"
    assert sweepctl("key", served.port, "--set", right).status == 0
    make_key(wrong)
    arguments = [served.port if word == "PORT" else word for word in words]
    done = sweepctl(*arguments, "--key-file", wrong)
    assert done.status == 4
    assert done.line.endswith(
        f"the device did not answer {what}; check that the key is the device's key"
    )
