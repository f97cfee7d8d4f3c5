"""The commands of ``--on``: their input, and the limits of their number and run time."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from bridge.run.notices import Notice, NoticeKind
from support.json_schema import problems, schemas
from tools.cli.on_event import EVENTS, MAX_WAITING, EventCommands

if TYPE_CHECKING:
    from pathlib import Path

FACTS = {"port": "virtual", "log": "run.mcap"}
LOST = Notice(NoticeKind.DEVICE_LOST, 1_700_000_000_500_000_000, "it's gone; $HOME")


def commands(*pairs: tuple[str, str], **limits: float) -> tuple[EventCommands, list[str]]:
    reported: list[str] = []
    return EventCommands(pairs, FACTS, reported.append, **limits), reported


def test_the_events_of_the_option_are_the_kinds_of_notices() -> None:
    assert tuple(kind.value for kind in NoticeKind) == EVENTS


def test_a_command_gets_the_event_as_its_schema_describes_it(tmp_path: Path) -> None:
    made, reported = commands(
        ("device-lost", f"cat > {tmp_path}/event"),
        ("device-lost", f'printf "%s: %s" "$SWEEPCTL_EVENT" "$SWEEPCTL_TEXT" > {tmp_path}/text'),
        ("finished", f"touch {tmp_path}/other"),
    )
    with made:
        made.notify(LOST)
    assert reported == []
    line = (tmp_path / "event").read_text()
    event = json.loads(line)
    schema = schemas()["event"]
    assert line.endswith("}\n")
    assert list(problems(event, schema, schema)) == []
    assert (event["event"], event["port"]) == ("device-lost", "virtual")
    assert event["time_unix_s"] == 1_700_000_000.5
    assert (tmp_path / "text").read_text() == "device-lost: it's gone; $HOME"
    assert not (tmp_path / "other").exists()


def test_a_command_that_reads_nothing_is_no_failure() -> None:
    made, reported = commands(("device-lost", "true"))
    with made:
        made.notify(LOST)
    assert reported == []


def test_a_failed_command_is_reported_with_its_last_words() -> None:
    made, reported = commands(("device-lost", "echo first >&2; echo no route to host >&2; exit 7"))
    with made:
        made.notify(LOST)
    (line,) = reported
    assert line.startswith("--on device-lost: echo first")
    assert line.endswith("exit status 7: no route to host")


def test_a_slow_command_is_killed_with_its_children(tmp_path: Path) -> None:
    slow = f"(sleep 3; touch {tmp_path}/late) & sleep 3; touch {tmp_path}/late"
    made, reported = commands(
        ("device-lost", slow), ("device-lost", f"touch {tmp_path}/next"), max_run_s=0.3
    )
    with made:
        made.notify(LOST)
    (line,) = reported
    assert line.endswith("no end after 0.3 s; killed")
    assert (tmp_path / "next").exists()
    processes = commands(("device-lost", f"pgrep -f {tmp_path}/late$ >&2 && exit 1; true"))
    with processes[0] as check:
        check.notify(LOST)
    assert not (tmp_path / "late").exists()


def test_no_more_commands_wait_than_the_limit(tmp_path: Path) -> None:
    made, reported = commands(("device-lost", f"sleep 0.2; echo >> {tmp_path}/ran"), max_end_s=0.3)
    with made:
        for _ in range(MAX_WAITING + 20):
            made.notify(LOST)
    ran = len((tmp_path / "ran").read_text().splitlines())
    assert 1 <= ran < MAX_WAITING
    assert any("commands were dropped" in line for line in reported)
