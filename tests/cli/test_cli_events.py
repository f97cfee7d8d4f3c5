"""The option ``--on EVENT COMMAND`` of ``simulate``, and its documentation page."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import click
import pytest

from bridge.run.notices import NoticeKind
from support.cli import sweepctl
from support.json_schema import problems, schemas
from support.root import ROOT
from tools.commands.connect import command as connect

if TYPE_CHECKING:
    from pathlib import Path

PAGE = ROOT / "docs" / "events.md"


@pytest.fixture(name="folder")
def working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_run_reports_its_events_and_the_schema_describes_them(folder: Path) -> None:
    done = sweepctl(
        *("simulate", "empty", "--max-time", "20", "--out", "a.mcap", "--json"),
        *("--fault", "battery-flat@5"),
        *("--on", "battery-low", "cat > low.json"),
        *("--on", "stopped-for-safety", "cat > stop.json"),
        *("--on", "finished", "cat > end.json"),
        *("--on", "device-lost", "cat > lost.json"),
    )
    assert done.status == 5
    schema = schemas()["event"]
    events = {}
    for name in ("low", "stop", "end"):
        events[name] = json.loads((folder / f"{name}.json").read_text())
        assert list(problems(events[name], schema, schema)) == []
    assert events["low"]["battery_v"] < 12.8
    assert events["stop"]["cause"] == "hardware"
    assert events["end"]["exit_status"] == 5
    assert events["end"]["summary"] == done.json
    assert not (folder / "lost.json").exists()


def test_a_lost_device_is_an_event(folder: Path) -> None:
    sweepctl(
        *("simulate", "empty", "--max-time", "20", "--out", "a.mcap", "--fault", "unplug@5:8"),
        *("--on", "device-lost", "cat > lost.json"),
    )
    assert json.loads((folder / "lost.json").read_text())["event"] == "device-lost"


@pytest.mark.usefixtures("folder")
def test_a_command_that_fails_is_named_and_changes_nothing_else() -> None:
    plain = sweepctl("simulate", "empty", "--max-time", "5", "--out", "a.mcap", "--json")
    failing = sweepctl(
        *("simulate", "empty", "--max-time", "5", "--out", "b.mcap", "--json"),
        *("--on", "finished", "echo noise; echo reason >&2; exit 9"),
    )
    assert (failing.status, plain.status) == (1, 1)
    assert failing.json | {"log": "a.mcap"} == plain.json
    assert "exit status 9: reason" in failing.err


@pytest.mark.usefixtures("folder")
def test_an_unknown_event_is_wrong_usage() -> None:
    done = sweepctl("simulate", "empty", "--on", "started", "true")
    assert done.status == 2
    assert "'started' is not one of 'finished'" in done.line


def test_completion_offers_the_events() -> None:
    option = next(each for each in connect.params if "--on" in each.opts)
    found = option.shell_complete(click.Context(connect), "st")
    assert [item.value for item in found] == ["stopped-for-safety"]


def test_the_page_lists_every_event_with_its_meaning() -> None:
    table = PAGE.read_text("utf-8").partition("<!-- events: begin -->")[2]
    rows = re.findall(
        r"^\| `([\w-]+)` \| (.*) \|$", table.partition("<!-- events: end -->")[0], re.MULTILINE
    )
    assert [name for name, _ in rows] == [kind.value for kind in NoticeKind]
    source = (ROOT / "bridge" / "run" / "notices.py").read_text("utf-8")
    for _, meaning in rows:
        assert f'"""{meaning}"""' in source


def test_the_example_of_the_page_is_an_event() -> None:
    found = re.search(r"```json\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    assert found is not None
    schema = schemas()["event"]
    assert list(problems(json.loads(found[1]), schema, schema)) == []
