"""Plug-ins of packages are used, checked before the robot moves, and disabled if they fail."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import pytest

from support.cli import decoded, plain_messages, sweepctl
from support.plugin_site import install, install_example, sweepctl_with

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

MESSAGE = """
from typing import Annotated
from protocol.schema.fields import U16, number
from protocol.schema.message import Direction, Message, RateClass, message

@message({type_id}, Direction.DEVICE, RateClass.STREAM, default_hz=2)
class {name}(Message):
    "A reading."
    level: Annotated[int, number(U16, "count", "of something")]
"""
MESSAGE_WITH_ENUM = '''
from enum import IntEnum
from typing import Annotated
from protocol.schema.fields import U8, number
from protocol.schema.message import Direction, Message, RateClass, message

class {enum}(IntEnum):
    """Levels."""
    THIN = 0
    THICK = 1

@message(0x51, Direction.DEVICE, RateClass.STREAM, default_hz=2)
class Fog(Message):
    """Fog."""
    {field}: Annotated[int, number(U8, "enum", "how dense", enum={enum})]
'''
PLANNER = """
from bridge.coverage.planner import Finish, PlannerState
from bridge.motion.legs import Drive

class Mine:
    state = PlannerState()
    def start(self, obs):
        return Drive(0.0, 0.3)
    def drain_events(self):
        return []
{more}

def make(model, rng, options):
    return Mine()
"""
RAISES = "    def next(self, result, obs):\n        raise RuntimeError('no map')\n"


@pytest.fixture
def site(tmp_path: Path) -> Path:
    return tmp_path / "site"


def summary(text: str) -> dict[str, object]:
    found: dict[str, object] = json.loads(text)
    return found


def test_the_example_has_one_of_each_and_works(site: Path) -> None:
    install_example(site)
    asked = ("--planner", "fixed-turn", "--planner-option", "legs=2", "--fault", "clumsy-gyro@4:1")
    rule = ("--supervise-rule", "too_far.distance_m=1")
    done = sweepctl_with(site, "simulate", "case-1", *asked, *rule, "--out", "d.mcap", "--json")
    assert done.status == 0, done.err
    assert summary(done.out)["outcome"] == "complete"
    log = site.parent / "d.mcap"
    assert len(plain_messages(log, "/device/dust")) > 10
    events = {(event.source, event.kind) for _, event in decoded(log, "/events")}
    assert {("supervise", "too_far"), ("fault", "began")} <= events
    (site.parent / "runs").mkdir()
    log.rename(site.parent / "runs" / "d.mcap")
    for named in ("runs/d.mcap", "latest"):
        counted = sweepctl_with(site, "dust", named)
        assert re.fullmatch(r"\d+ particles in \d+ messages\n", counted.out), counted.err


def test_every_artefact_has_the_message_of_a_plug_in(site: Path) -> None:
    install_example(site)
    for what in ("c", "dbc", "lua", "proto", "md"):
        assert sweepctl_with(site, "generate", what, "--out", "made").status == 0
    made = list((site.parent / "made").iterdir())
    for path in made:
        if path.suffix in {".h", ".dbc", ".lua", ".proto", ".md"}:
            assert "dust" in path.read_text(encoding="utf-8").lower(), path
    assert any("sp_dust_encode" in path.read_text(encoding="utf-8") for path in made)


def test_help_and_completion_know_plug_ins_without_importing_them(site: Path) -> None:
    install_example(site)
    (site / "sweepctl_example").unlink()  # only the metadata is left
    done = sweepctl_with(site, "--help")
    assert done.status == 0
    assert re.search(r"^Plug-ins:\n  dust +Of package sweepctl-example 1.0", done.out, re.MULTILINE)
    assert "|fixed-turn|MODULE:CALLABLE]" in sweepctl_with(site, "simulate", "--help").out
    compare = sweepctl_with(site, "experiment", "--help").out
    assert "fixed-turn" in compare
    wrong = sweepctl_with(site, "simulate", "case-1", "--planner", "fixed-turns")
    assert wrong.status == 2
    assert "Did you mean 'fixed-turn'?" in wrong.err


def test_a_planner_in_a_file_of_the_working_directory(site: Path) -> None:
    site.mkdir()
    source = PLANNER.format(
        more="    def next(self, result, obs):\n        return Finish('there')\n"
    )
    (site.parent / "mine.py").write_text(source)
    done = sweepctl_with(site, "simulate", "empty", "--planner", "mine:make", "--json")
    assert done.status == 0, done.err
    assert (summary(done.out)["planner"], summary(done.out)["outcome"]) == ("mine:make", "complete")


def test_compare_runs_the_planner_of_a_plug_in(site: Path) -> None:
    install_example(site)
    run = ("experiment", "compare", "--rooms", "empty", "--planners", "fixed-turn,u-shape")
    limits = ("--seeds", "1", "--max-time", "20", "--jobs", "1", "--out", "cmp", "--json")
    done = sweepctl_with(site, *run, *limits)
    assert done.status == 0, done.err
    runs = (site.parent / "cmp" / "runs.csv").read_text(encoding="utf-8")
    assert "fixed-turn" in runs
    assert "u-shape" in runs
    wrong = sweepctl_with(site, *run[:-1], "fixed-turn,spirl", *limits)
    assert (wrong.status, "'spirl' is not one of" in wrong.err) == (2, True)


def test_a_missing_method_is_named_before_anything_moves(site: Path) -> None:
    install(site, "lame", {"planners": {"lame": "lame:make"}}, {"lame": PLANNER.format(more="")})
    for planner in ("lame", "lame:make"):
        done = sweepctl_with(site, "simulate", "empty", "--planner", planner, "--out", "no.mcap")
        assert done.status == 2
        assert "Mine is no planner: it lacks next()" in done.err
        assert len(done.err.splitlines()) == 1
    assert (
        "of package lame 1.0" in sweepctl_with(site, "simulate", "empty", "--planner", "lame").err
    )
    assert not (site.parent / "no.mcap").exists()
    live = sweepctl_with(site, "connect", "/dev/none", "--plan", "lame")
    assert (live.status, "it lacks next()" in live.err) == (2, True)


def test_a_planner_that_raises_stops_the_robot_and_names_its_package(site: Path) -> None:
    install(
        site, "lost", {"planners": {"lost": "lost:make"}}, {"lost": PLANNER.format(more=RAISES)}
    )
    done = sweepctl_with(site, "simulate", "empty", "--planner", "lost", "--json")
    assert done.status == 1
    found = summary(done.out)
    assert found["outcome"] == "fault"
    reason = str(found["reason"])
    assert "RuntimeError: no map; raised by planner 'lost' of package lost 1.0" in reason
    assert "the device has confirmed the stop" in reason
    assert "Traceback" not in done.err


def test_two_packages_that_claim_one_type_are_rejected_by_name(site: Path) -> None:
    for package, name in (("fog", "Fog"), ("smoke", "Smoke")):
        source = {package: MESSAGE.format(type_id="0x51", name=name)}
        install(site, package, {"messages": {package: f"{package}:{name}"}}, source)
    done = sweepctl_with(site, "generate", "md", "--out", "made")
    assert done.status == 0
    (line,) = done.err.splitlines()[:1]
    assert "type 0x51 is claimed by message 'fog' of package fog 1.0 and by message" in line
    text = (site.parent / "made" / "PROTOCOL.md").read_text(encoding="utf-8")
    assert "`fog`" not in text
    assert "`smoke`" not in text


@pytest.mark.parametrize(
    ("type_id", "name", "printed"),
    [
        ("0x10", "Fog", "type 0x10 is not from 0x50 to 0x5f"),
        ("0x51", "Status", "the name 'status' is taken"),
    ],
)
def test_a_message_that_cannot_join_is_disabled_by_name(
    site: Path, type_id: str, name: str, printed: str
) -> None:
    source = {"fog": MESSAGE.format(type_id=type_id, name=name)}
    install(site, "fog", {"messages": {"fog": f"fog:{name}"}}, source)
    done = sweepctl_with(site, "generate", "md", "--out", "made")
    assert done.status == 0
    assert f"message 'fog' of package fog 1.0: {printed}; it is disabled" in done.err


@pytest.mark.parametrize(
    ("source", "printed"),
    [
        (
            MESSAGE_WITH_ENUM.format(enum="Mode", field="wish"),
            "the enumeration name 'Mode' is taken",
        ),
        (
            MESSAGE_WITH_ENUM.format(enum="Fresh", field="node"),
            "fog: the field name node is reserved",
        ),
    ],
)
def test_a_message_with_a_name_of_sweepctl_is_disabled(
    site: Path, source: str, printed: str
) -> None:
    install(site, "fog", {"messages": {"fog": "fog:Fog"}}, {"fog": source})
    done = sweepctl_with(site, "generate", "proto", "--out", "made")
    assert done.status == 0
    assert f"message 'fog' of package fog 1.0: {printed}; it is disabled" in done.err


def test_two_packages_with_one_enumeration_name_are_rejected(site: Path) -> None:
    for package, type_id in (("fog", "0x51"), ("smoke", "0x52")):
        source = MESSAGE_WITH_ENUM.format(enum="Density", field="density")
        source = source.replace("0x51", type_id).replace("Fog", package.title())
        points = {"messages": {package: f"{package}:{package.title()}"}}
        install(site, package, points, {package: source})
    done = sweepctl_with(site, "generate", "c", "--out", "made")
    assert "enumeration name 'Density' is claimed by message 'fog' of package fog 1.0" in done.err


def test_documentation_of_several_lines_is_valid_in_every_format(site: Path) -> None:
    source = MESSAGE_WITH_ENUM.format(enum="Density", field="density")
    source = source.replace('"""Fog."""', '"""Fog.\n\n    More about fog.\n    """')
    source = source.replace('"""Levels."""', '"""\n    Levels.\n    """')
    install(site, "fog", {"messages": {"fog": "fog:Fog"}}, {"fog": source})
    for what in ("c", "proto", "lua", "md", "dbc"):
        done = sweepctl_with(site, "generate", what, "--out", "made")
        assert (done.status, done.err) == (0, ""), what
    made = site.parent / "made"
    proto = (made / "sweepctl.proto").read_text(encoding="utf-8")
    assert "// Fog.\n//\n// More about fog.\n" in proto
    header = (made / "sweepctl_protocol.h").read_text(encoding="utf-8")
    assert "/* Levels. */" in header


def test_a_plug_in_that_exits_at_its_import_is_disabled(site: Path) -> None:
    install(site, "fog", {"messages": {"fog": "fog:Fog"}}, {"fog": "raise SystemExit('bye')\n"})
    done = sweepctl_with(site, "generate", "md", "--out", "made")
    assert done.status == 0
    assert "message 'fog' of package fog 1.0 cannot be loaded: SystemExit: bye" in done.err


def test_a_plug_in_that_raises_at_its_import_is_disabled_in_one_line(site: Path) -> None:
    kinds = ("messages", "faults", "rules", "planners", "commands")
    entries = {kind: {"broken": "broken:thing"} for kind in kinds}
    install(site, "broken-package", entries, {"broken": "raise RuntimeError('ouch')\n"})
    run = ("simulate", "empty", "--planner", "u-shape", "--max-time", "3")
    done = sweepctl_with(site, *run, "--supervise-rule", "stall.reaction=stop", "--json")
    assert summary(done.out)["outcome"] == "timeout", done.err
    for word in ("message", "fault", "rule"):
        text = f"{word} 'broken' of package broken-package 1.0 cannot be loaded: RuntimeError: ouch"
        assert done.err.count(text) == 1, done.err
    for arguments in (("broken",), ("simulate", "empty", "--planner", "broken")):
        failed = sweepctl_with(site, *arguments)
        assert failed.status in {1, 2}
        assert "of package broken-package 1.0 cannot be loaded: RuntimeError: ouch" in failed.err
        assert "Traceback" not in failed.err


def test_a_command_that_raises_is_one_line(site: Path) -> None:
    source = "import click\n@click.command()\ndef boom():\n    'Fail.'\n    raise KeyError('x')\n"
    install(site, "boom", {"commands": {"boom": "boom:boom"}}, {"boom": source})
    done = sweepctl_with(site, "boom")
    assert done.status == 1
    assert done.err == "sweepctl: command 'boom' of package boom 1.0 raised KeyError: 'x'\n"


def test_two_packages_with_one_name_are_rejected(site: Path) -> None:
    for package in ("one", "two"):
        points = {"planners": {"same": f"{package}:make"}, "commands": {"same": f"{package}:run"}}
        install(site, package, points)
    for arguments in (("simulate", "empty", "--planner", "same"), ("same",)):
        done = sweepctl_with(site, *arguments)
        assert done.status in {1, 2}
        assert "is offered by one 1.0 and two 1.0; uninstall all but one" in done.err


RULE = """
from dataclasses import dataclass
from bridge.supervise.settings import PluggedRule

@dataclass(frozen=True, slots=True)
class Rule(PluggedRule):
    "It fails."
    def condition(self, model):
        return Condition()

class Condition:
    grave = False
    def holds(self, inputs, measured):
        raise ValueError("no")
    def evidence(self):
        return "", {}
    def restart(self):
        pass
"""


def test_a_rule_that_raises_is_disabled_and_the_run_continues(site: Path) -> None:
    install(site, "bad-rule", {"rules": {"bad": "bad:Rule"}}, {"bad": RULE})
    run = ("simulate", "empty", "--planner", "u-shape", "--max-time", "5", "--out", "r.mcap")
    done = sweepctl_with(site, *run, "--supervise-rule", "bad.reaction=stop")
    assert done.status == 1, "the time limit did not end the run"
    found = decoded(site.parent / "r.mcap", "/events")
    events = [event for _, event in found if event.kind == "bad"]
    assert len(events) == 1
    assert "rule 'bad' of package bad-rule 1.0 raised ValueError: no" in events[0].text


DUSTY = """
from dataclasses import dataclass
from bridge.supervise.settings import PluggedRule
from sweepctl_example.messages import Dust

@dataclass(frozen=True, slots=True)
class Rule(PluggedRule):
    "There is dust."
    def condition(self, model):
        return Condition()

class Condition:
    grave = False
    def holds(self, inputs, measured):
        self.dust = inputs.newest(Dust)
        return self.dust is not None and inputs.time_s - inputs.arrived_s[Dust] < 1.0
    def evidence(self):
        return f"{self.dust.rate_hz:g} particles a second", {"particles": self.dust.particles}
    def restart(self):
        pass
"""


def test_a_rule_reads_the_messages_of_plug_ins(site: Path) -> None:
    install_example(site)
    install(site, "dusty", {"rules": {"dusty": "dusty:Rule"}}, {"dusty": DUSTY})
    run = ("simulate", "empty", "--planner", "u-shape", "--max-time", "5", "--out", "r.mcap")
    done = sweepctl_with(site, *run, "--supervise-rule", "dusty.reaction=stop")
    assert done.status == 5, "not stopped for safety"
    found = decoded(site.parent / "r.mcap", "/events")
    (event,) = [event for _, event in found if event.kind == "dusty"]
    assert "20 particles a second" in event.text


def test_without_plug_ins_nothing_is_imported_for_them() -> None:
    assert "Plug-ins" not in sweepctl("--help").out
