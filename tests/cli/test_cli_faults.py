"""Faults on the command line: the list, rejections, the control socket, the page in the docs."""

from __future__ import annotations

import json
import re
import stat
from typing import TYPE_CHECKING

import pytest

from sim_device.faults.kinds import KINDS, parse_fault
from sim_device.faults.spec import FaultSpecError
from support.cli import sweepctl
from support.root import ROOT
from support.two_processes import Command, Emulator
from tools.cli.fault_help import faults_page

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


def test_the_list_explains_every_kind() -> None:
    done = sweepctl("emulate", "--list-faults")
    assert (done.status, done.err) == (0, "")
    for kind in KINDS.values():
        assert f"\n{kind.name}\n" in done.out
        assert f"--fault {kind.example}" in done.out
        for argument in kind.arguments:
            assert f"    {argument.name}: " in done.out
    assert max(map(len, done.out.splitlines())) <= 100
    listed = sweepctl("emulate", "--list-faults", "--json").json["faults"]
    assert [item["kind"] for item in listed] == list(KINDS)
    assert listed[0]["arguments"][0]["high"] == 1.0


def test_the_page_is_fresh() -> None:
    assert faults_page() == PAGE, "make generated"


PAGE = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| `([\w-]+)` \| .+? \| (lasts|at once) \| `([^`]+)` \|$", PAGE, re.MULTILINE)
"""Rows of the page's table of kinds: kind, duration, example."""
ARGUMENTS = re.findall(
    r"^\| `([\w-]+)` \| `(\w+)` \| ([^|]+) \| ([^|]+) \| [^|]+ \|$", PAGE, re.MULTILINE
)
"""Rows of the page's table of arguments: kind, name, default, allowed values."""


def rejected(text: str) -> bool:
    try:
        parse_fault(text)
    except FaultSpecError:
        return True
    return False


def test_the_page_has_every_kind_that_the_command_takes_and_no_other() -> None:
    listed = sweepctl("emulate", "--list-faults", "--json").json["faults"]
    assert [row[0] for row in ROWS] == [item["kind"] for item in listed]
    assert rejected("no-such-kind@1")


@pytest.mark.parametrize("row", ROWS, ids=[row[0] for row in ROWS])
def test_the_pages_statements_on_a_kind_hold(row: tuple[str, ...]) -> None:
    """Test example, defaults, ranges, words and duration of a kind with the parser."""
    kind, duration, example = row
    assert parse_fault(example).kind.name == kind
    given = parse_fault(f"{kind}@1").values
    assert rejected(f"{kind}@1:2") is (duration == "at once")
    stated = [argument[1:] for argument in ARGUMENTS if argument[0] == kind]
    assert [name for name, _, _ in stated] == list(given)
    for name, default, allowed in stated:
        value = given[name]
        assert default == (value if isinstance(value, str) else f"{value:g}")
        if isinstance(value, str):
            for word in allowed.split(", "):
                assert parse_fault(f"{kind}@1:{name}={word}").values[name] == word
            assert rejected(f"{kind}@1:{name}=nothing")
            continue
        low, high = (float(x) for x in re.findall(r"-?[\d.]+(?:e[+-]?\d+)?", allowed)[:2])
        step = 1e-6 * max(abs(low), abs(high))
        for end, beyond in ((low, low - step), (high, high + step)):
            assert parse_fault(f"{kind}@1:{name}={end!r}").values[name] == end
            assert rejected(f"{kind}@1:{name}={beyond!r}")


@pytest.mark.parametrize("command", ["emulate", "simulate"])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("wheel-stucc@1", "did you mean wheel-stuck?"),
        ("silence", "no time: write"),
        ("bit-flips@1:2:rate=2", "rate '2' is not in 0 to 1"),
        ("obstacle@1:index=7", "the room has no obstacle 7; it has only 0"),
    ],
)
def test_a_fault_that_cannot_be(tmp_path: Path, command: str, text: str, message: str) -> None:
    out = ("--out", tmp_path / "log.mcap") if command == "simulate" else ()
    done = sweepctl(command, "case-1", "--fault", "silence@1", "--fault", text, *out)
    assert (done.status, done.out) == (2, "")
    assert "--fault" in done.line
    assert message in done.line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--lan",), "--lan needs --link udpcan or tcp"),
        (("--listen", "127.0.0.1:0"), "--listen needs --link tcp"),
        (("--link", "tcp", "--listen", "7000"), "'7000' is not HOST:PORT"),
        (
            ("--link", "tcp", "--listen", "127.0.0.1:70000"),
            "port 70000 is not in the range 0 to 65535",
        ),
        (("--link", "tcp", "--lan", "--listen", "127.0.0.1:0"), "give one"),
        (("--link", "tcp", "--pty-link", "x"), "--pty-link needs --link pty or slcan"),
        (("--link", "udpcan", "--baud", "9600"), "--baud needs --link pty or tcp"),
        (("--baud", "300"), "300 is not 0"),
        (("--latency-ms", "nan"), "'nan' is not a number"),
    ],
)
def test_options_that_do_not_go_together(arguments: tuple[str, ...], message: str) -> None:
    done = sweepctl("emulate", *arguments)
    assert (done.status, done.out) == (2, "")
    assert message in done.line


def test_json_is_for_the_list() -> None:
    done = sweepctl("emulate", "--json")
    assert done.status == 2
    assert "--json needs --list-faults" in done.line
    assert done.json["exit_status"] == 2


@pytest.fixture(scope="module")
def device(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Yield the control socket of a running emulator."""
    folder = tmp_path_factory.mktemp("control")
    with Emulator(folder, "--control", folder / "sweeper.ctl"):
        yield folder / "sweeper.ctl"


def test_switched_while_it_runs(device: Path) -> None:
    assert stat.S_IMODE(device.stat().st_mode) == 0o600
    done = sweepctl("fault", device, "silence:0.05", "wheel-slip::left", "reset@1e6", "--json")
    assert done.json == {
        "begun": [
            "silence:0.05:way=both",
            "wheel-slip:side=left,share=0.3",
            "reset@1000000:cause=pin",
        ],
        "cleared": 0,
        "active": done.json["active"],
        "waiting": ["reset@1000000:cause=pin"],
    }
    assert "wheel-slip:side=left,share=0.3" in done.json["active"]
    done = sweepctl("fault", device, "--clear", "reset", "--list")
    assert "ended: 1" in done.out
    assert "active: wheel-slip:side=left,share=0.3" in done.out
    assert "waiting" not in done.out
    done = sweepctl("fault", device, "--clear-all", "--list")
    assert "active: none" in done.out


def test_the_true_state_is_printed(device: Path) -> None:
    truth = sweepctl("fault", device, "--truth", "--json").json["truth"]
    assert (truth["path_m"], truth["collisions"]) == (0.0, 0)
    assert truth["time_s"] > 0.0
    assert "collisions: 0" in sweepctl("fault", device, "--truth").out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("silense",), "did you mean silence?"),
        (("obstacle:index=9",), "the room has no obstacle 9"),
        (("--clear", "silense"), "'silense' is not one of"),
        (("silence\nclear",), "one line"),
        (("silence:" + "x" * 2000,), "shorter than 1024 bytes"),
        ((), "nothing to do"),
    ],
)
def test_requests_that_the_control_socket_rejects(
    device: Path, arguments: tuple[str, ...], message: str
) -> None:
    done = sweepctl("fault", device, *arguments)
    assert (done.status, done.out) == (2, "")
    assert message in done.line


@pytest.mark.parametrize("wrong", [("silense",), ("obstacle:index=9",), ("--clear", "silense")])
def test_one_that_cannot_be_leaves_the_others_unbegun(device: Path, wrong: tuple[str, ...]) -> None:
    done = sweepctl("fault", device, "wheel-slip::left", *wrong)
    assert done.status == 2
    done = sweepctl("fault", device, "--list")
    assert "active: none" in done.out


def test_no_owner_and_another_owner(device: Path, tmp_path: Path) -> None:
    done = sweepctl("fault", tmp_path / "none", "silence", "--json")
    assert done.status == 3
    assert "was it started with --control" in done.line
    assert json.loads(done.out)["exit_status"] == 3
    with Command("emulate", "--control", device, cwd=tmp_path) as second:
        ended = second.end()
    assert ended.status == 3
    assert "another emulator that still runs listens" in ended.complaint
    (tmp_path / "file").write_text("precious")
    with Command("emulate", "--control", tmp_path / "file", cwd=tmp_path) as second:
        ended = second.end()
    assert ended.status == 3
    assert "exists and is no socket" in ended.complaint
    assert (tmp_path / "file").read_text() == "precious"
    assert sweepctl("fault", device, "--list").status == 0
