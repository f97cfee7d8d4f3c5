"""Configuration files: precedence, named robots, sources, and errors by key."""

from __future__ import annotations

import json
import re
from dataclasses import fields
from typing import TYPE_CHECKING

import pytest

from support.cli import sweepctl
from support.root import ROOT
from tools.cli.configuration import Defaults, NamedRobot
from tools.cli.main import cli
from tools.commands.calibrate import command as calibrate
from tools.commands.connect import command as connect
from tools.commands.drive import command as drive
from tools.commands.param import command as param
from tools.commands.simulate import command as simulate
from tools.commands.stop import command as stop

if TYPE_CHECKING:
    from pathlib import Path

    import click

PAGE = ROOT / "docs" / "configuration.md"
KEY = "00112233445566778899aabbccddeeff"


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working directory and an empty folder for the user's file."""
    monkeypatch.delenv("SWEEPCTL_CONFIG", raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "xdg"))
    (tmp_path / "xdg" / "sweepctl").mkdir(parents=True)
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    return tmp_path


def users(home: Path, text: str) -> None:
    (home / "xdg" / "sweepctl" / "config.toml").write_text(text)


def local(home: Path, text: str) -> None:
    (home / "work" / "sweepctl.toml").write_text(text)


def parameters(command: click.Command, *words: str) -> dict[str, object]:
    """Return the values with which the command would run."""
    parent = cli.make_context("sweepctl", [str(command.name)], resilient_parsing=True)
    assert command.name is not None
    return command.make_context(command.name, list(words), parent=parent).params


def test_the_command_line_counts_most_then_the_local_file_then_the_users(home: Path) -> None:
    assert parameters(simulate, "case-1")["noise"] == "typical"
    users(home, "[defaults]\nnoise = 'harsh'\nplanner = 'u-shape'\n")
    assert parameters(simulate, "case-1")["noise"] == "harsh"
    local(home, "[defaults]\nnoise = 'paper'\n")
    found = parameters(simulate, "case-1")
    assert (found["noise"], found["planner"]) == ("paper", "u-shape")
    assert parameters(simulate, "case-1", "--noise", "none")["noise"] == "none"


def test_a_named_robot_gives_port_robot_file_key_and_node(home: Path) -> None:
    local(
        home,
        "[defaults]\nbaud = 115200\nnode = 3\n"
        "[robots.kitchen]\nport = '/dev/ttyK'\nrobot = 'k.toml'\nkey_file = 'k.key'\nnode = 7\n",
    )
    found = parameters(connect, "kitchen")
    assert found["port"] == "/dev/ttyK"
    assert (str(found["robot"]), str(found["key_file"])) == ("k.toml", "k.key")
    assert (found["node"], found["baud"]) == (7, 115_200)
    assert parameters(connect, "kitchen", "--node", "2")["node"] == 2
    assert parameters(connect, "--node", "2", "kitchen")["node"] == 2
    opened = parameters(drive, "kitchen")
    assert (opened["port"], opened["node"]) == ("/dev/ttyK", 7)
    assert parameters(connect, "/dev/other")["node"] == 3


def test_calibration_takes_the_named_robots_own_file_only(home: Path) -> None:
    local(
        home,
        "[defaults]\nrobot = 'all.toml'\n[robots.kitchen]\nport = '/dev/ttyK'\nrobot = 'k.toml'\n"
        "[robots.bath]\nport = '/dev/ttyB'\n",
    )
    gyro, diff = calibrate.commands["gyro"], param.commands["diff"]
    assert str(parameters(gyro, "kitchen")["robot"]) == "k.toml"
    assert str(parameters(gyro, "kitchen", "--robot", "x.toml")["robot"]) == "x.toml"
    assert parameters(gyro, "bath")["robot"] is None
    assert parameters(gyro, "/dev/other")["robot"] is None
    assert str(parameters(diff, "kitchen")["file"]) == "k.toml"
    assert str(parameters(diff, "kitchen", "x.toml")["file"]) == "x.toml"
    for port in ("bath", "/dev/other"):
        done = sweepctl("param", "diff", port)
        assert (done.status, "Missing argument" in done.err) == (2, True)


def test_completion_offers_named_robots(home: Path) -> None:
    local(home, "[robots.kitchen]\nport = '/dev/ttyK'\n")
    context = cli.make_context("sweepctl", ["connect"], resilient_parsing=True)
    port = next(param for param in connect.params if param.name == "port")
    assert [item.value for item in port.shell_complete(context, "kit")] == ["kitchen"]


def test_both_files_may_describe_one_robot(home: Path) -> None:
    users(home, "[robots.kitchen]\nport = '/dev/a'\nnode = 1\n")
    local(home, "[robots.kitchen]\nport = '/dev/b'\n")
    found = parameters(connect, "kitchen")
    assert (found["port"], found["node"]) == ("/dev/b", 1)


def test_paths_begin_at_the_folder_of_the_file(home: Path) -> None:
    users(home, "[defaults]\nrobot = 'mine.toml'\n")
    folder = home / "xdg" / "sweepctl"
    assert parameters(simulate, "case-1")["robot"] == folder / "mine.toml"


def test_the_variable_names_the_only_file(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    local(home, "[defaults]\nnoise = 'paper'\n")
    other = home / "other.toml"
    other.write_text("[defaults]\nplanner = 'random'\n")
    monkeypatch.setenv("SWEEPCTL_CONFIG", str(other))
    found = parameters(simulate, "case-1")
    assert (found["noise"], found["planner"]) == ("typical", "random")
    monkeypatch.setenv("SWEEPCTL_CONFIG", "")
    assert parameters(simulate, "case-1")["planner"] == "recovery"
    monkeypatch.setenv("SWEEPCTL_CONFIG", "/none.toml")
    assert sweepctl("simulate", "case-1").status == 2


def test_config_show_lists_the_source_of_each_value_and_no_key(home: Path) -> None:
    (home / "work" / "k.key").write_text(KEY)
    users(home, "[defaults]\nnoise = 'harsh'\n")
    local(home, "[robots.kitchen]\nport = '/dev/ttyK'\nkey_file = 'k.key'\n")
    done = sweepctl("config", "show")
    assert done.status == 0
    lines = [line.split() for line in done.out.splitlines()]
    assert ["defaults.planner", "recovery", "built-in"] in lines
    assert ["defaults.node", "built-in"] in lines
    assert ["robots.kitchen.port", "/dev/ttyK", "sweepctl.toml"] in lines
    found = json.loads(sweepctl("config", "show", "--json").out)
    assert found["defaults"]["noise"]["source"].endswith("config.toml")
    assert [file["exists"] for file in found["files"]] == [True, True]
    assert KEY not in done.out + json.dumps(found)


def test_the_source_of_a_value_is_printed_when_it_is_used(home: Path) -> None:
    local(home, "[defaults]\nnoise = 'none'\nplanner = 'u-shape'\n")
    done = sweepctl("simulate", "empty", "--max-time", "2")
    assert "--noise none (sweepctl.toml)" in done.err
    assert "--planner u-shape (sweepctl.toml)" in done.err


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("[default]\n", "default: no such key; did you mean defaults?"),
        ("[defaults]\nnois = 'none'\n", "defaults.nois: no such key; did you mean defaults.noise?"),
        ("[defaults]\nnoise = 'loud'\n", "defaults.noise: 'loud' is not one of"),
        ("[defaults]\nplan = 'recovery'\n", "defaults.plan: no such key"),
        ("[robots.k]\nnode = 1\n", "robots.k.port: is missing"),
        ("[robots.k]\n", "sweepctl.toml: robots.k.port: is missing"),
        ("[robots.k]\nport = '/dev/x'\nnode = 16\n", "robots.k.node: 16 is out of range 1..15"),
        ("[robots.'a/b']\nport = '/dev/x'\n", "a name has no slash, colon, dot or space"),
        ("[robots]\nk = 1\n", "robots.k: must be a table"),
        (f"[robots.k]\nport = '/dev/x'\nkey = '{KEY}'\n", "robots.k.key: no such key"),
        ("noise =", "not valid TOML"),
    ],
)
def test_errors_are_named_without_printing_a_key(home: Path, text: str, printed: str) -> None:
    local(home, text)
    done = sweepctl("simulate", "empty")
    assert done.status == 2
    assert printed in done.err
    assert "sweepctl.toml" in done.err
    assert KEY not in done.err
    assert len(done.err.splitlines()) == 1


def test_stop_works_with_any_files(home: Path) -> None:
    local(home, "[defaults]\nnois = 1\n")
    assert parameters(stop, "/dev/ttyX")["port"] == "/dev/ttyX"
    assert "sweepctl.toml" in sweepctl("stop", "/dev/none").err


def test_a_misspelt_robot_is_no_port(home: Path) -> None:
    local(home, "[robots.kitchen]\nport = '/dev/ttyK'\n")
    done = sweepctl("connect", "kitchn")
    assert (done.status, "did you mean 'kitchen'?" in done.err) == (2, True)


def test_the_page_can_be_followed(home: Path) -> None:
    page = PAGE.read_text(encoding="utf-8")
    example = re.search(r"^```toml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert example is not None
    local(home, example[1])
    (home / "work" / "robots").mkdir()
    (home / "work" / "robots" / "small.toml").write_text("name = 'small'\n")
    assert sweepctl("config", "show").status == 0
    assert str(parameters(connect, "kitchen")["robot"]) == "robots/kitchen.toml"
    done = sweepctl("simulate", "case-1", "--max-time", "2")
    assert "--robot robots/small.toml (sweepctl.toml)" in done.err


@pytest.mark.usefixtures("home")
def test_the_built_in_values_are_those_of_the_commands() -> None:
    rows = [line.split() for line in sweepctl("config", "show").out.splitlines()]
    table = {row[0]: row[1] for row in rows if len(row) > 1}
    found = parameters(simulate, "case-1") | parameters(connect, "/dev/x")
    for key in ("planner", "noise"):
        assert table[f"defaults.{key}"] == parameters(simulate, "case-1")[key]
    assert table["defaults.baud"] == str(found["baud"])


def test_the_page_lists_every_key() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for key in {each.name for table in (Defaults, NamedRobot) for each in fields(table)}:
        assert f"| `{key}` | " in page
