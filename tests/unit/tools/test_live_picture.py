"""The dashboard, drawn off screen: content at each size, and geometry of the map."""

from __future__ import annotations

import io
import itertools

import pytest
from rich.console import Console
from rich.screen import Screen

from bridge.coverage.swept_map import SweptMap
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from bridge.run.dead_man_switch import DeadManSwitch
from bridge.run.host import Host
from bridge.run.manual import Operator
from bridge.run.mission import Mission
from bridge.run.options import HostOptions
from bridge.session.records import EventRecord, LogRecord, Severity
from protocol.messages.device import Imu, LinkCounters, Power, Range, Status
from tools.cli.console import err
from tools.cli.visible_console import MAX_COLUMNS, MAX_ROWS, VisibleConsole
from tools.cli.visible_text import is_visible
from tools.live.live import Dashboard, EventLines
from tools.live.map import swept_picture
from tools.live.operating import Operating
from tools.live.tables import Rates, status_line

MODEL = RobotModel()


ORIGIN = Pose2(0.0, 0.0, 0.0)


def host(*, pose: Pose2 = ORIGIN) -> Host:
    ids = itertools.count(1)
    options = HostOptions(0, "", pose)
    found = Host(MODEL, NullSink(), options, Mission(None), lambda: next(ids))
    for message in (
        Imu(0, 0, 16384, 0, 0, 0, 131),
        Range(1234, 80, 255, 1, 30),
        Power(15_500, 200, 3, 4),
        Status(1, 4, 1 << 6, 0, 7),
    ):
        found.state.take(message, 0, 1.0)
    return found


def drawn(picture: Dashboard, width: int, height: int) -> list[str]:
    out = io.StringIO()
    console = Console(file=out, width=width, height=height, force_terminal=True, color_system=None)
    console.print(picture.layout(width, height), height=height)
    return out.getvalue().splitlines()


@pytest.mark.parametrize(("width", "height"), [(140, 42), (120, 30), (100, 40), (80, 24), (60, 16)])
def test_essential_content_is_shown_at_every_size(width: int, height: int) -> None:
    events = EventLines(NullSink(), plain=False)
    events.write(EventRecord(0, Severity.WARNING, "device", "fault", "battery_low", {}))
    lines = drawn(Dashboard(host().snapshot, events), width, height)
    assert len(lines) <= height
    assert max(map(len, lines)) <= width
    text = "\n".join(lines)
    assert "velocity" in text
    assert "operator" in text, "the cause of the stop is shown"
    assert "battery_low" in text
    assert "+0.0" in text
    if height >= 24:
        for part in ("15.50 V", "1.23", "bumper", "lost", "+1.00"):
            assert part in text, part


@pytest.mark.parametrize(("width", "height"), [(40, 10), (60, 14), (50, 6)])
def test_the_keys_stay_in_the_lowest_window(width: int, height: int) -> None:
    found = host()

    class Loop:
        host = found
        snapshot = found.snapshot()

    operator = Operator(MODEL, DeadManSwitch(0.3, 0.15))
    operating = Operating(Loop(), operator, on_resume=lambda: None)  # type: ignore[arg-type]  # has all that is used
    operating.message = "mark 1 recorded"
    lines = drawn(
        Dashboard(found.snapshot, EventLines(NullSink(), plain=False), operating), width, height
    )
    assert len(lines) == height
    assert max(map(len, lines)) <= width
    assert "session  closed" in lines[1]
    assert lines[-1].startswith("space STOP"), "the keys are the last line"


@pytest.mark.parametrize(
    ("counters", "shown"),
    [
        ((9, 0, 0, 0, 0, 0, 0, 0), "0 damaged, 0 dropped"),
        ((9, 3, 0, 2, 5, 0, 0, 0), "3 damaged, 7 dropped"),
        ((9, 0, 0, 0, 0, 96, 8, 2), "96 errors, 2 × off"),
        ((9, 1, 0, None, None, None, None, None), "1 damaged, 0 dropped"),  # an older device
    ],
)
def test_the_device_s_end_of_the_link_is_shown(
    counters: tuple[int | None, ...], shown: str
) -> None:
    found = host()
    found.state.take(LinkCounters(*counters), 0, 1.0)  # type: ignore[arg-type]  # absent fields
    dashboard = Dashboard(found.snapshot, EventLines(NullSink(), plain=False))
    assert shown in " ".join(" ".join(drawn(dashboard, 200, 42)).split())


def test_the_map_shows_where_it_swept_and_where_it_looks() -> None:
    facing_up = host(pose=Pose2(0.0, 0.0, 1.5708))
    facing_up.swept = SweptMap(MODEL)
    for i in range(100):
        facing_up.swept.update(Pose2(0.01 * i, 0.0, 0.0))
    picture = swept_picture(facing_up.snapshot(), 40, 20).plain
    rows = picture.splitlines()
    assert sum(row.count("↑") for row in rows) == 1
    assert sum(row.count("█") + row.count("▀") + row.count("▄") for row in rows) > 20
    row = next(r for r in rows if "↑" in r)
    assert row.index("↑") < 8, "the robot is at the left end of the swept area"
    assert len(rows) <= 10 + 1


def test_a_trail_is_drawn_where_nothing_is_swept() -> None:
    way = [(0.0, 0.05 * i) for i in range(40)]
    rows = swept_picture(host(pose=Pose2(0.0, 2.0, 0.0)).snapshot(), 30, 20, way).plain.splitlines()
    assert "→" in rows[0] + rows[1], "north is up, and the trail ends in the north"
    assert sum(any(c in r for c in "█▀▄") for r in rows) >= 8


def test_rates_are_differences_of_counts() -> None:
    someone = host()
    rates, statistics = Rates(someone.snapshot), someone.session.link.statistics
    rates.look(10_000_000_000)
    statistics.by_type.update({0x13: 200, 0x20: 40})
    statistics.bytes_in = 5000
    rates.look(10_500_000_000)
    assert rates.hz == {}, "rates need at least a second"
    rates.look(12_000_000_000)
    assert rates.hz == {"imu": pytest.approx(100.0), "range": pytest.approx(20.0)}
    assert rates.bytes_s[0] == pytest.approx(2500.0)


def test_without_a_terminal_each_event_is_a_plain_line(capsys: pytest.CaptureFixture[str]) -> None:
    err.cache_clear()
    events = EventLines(NullSink(), plain=True)
    record = EventRecord(5 * 10**9, Severity.ERROR, "safety", "stop", "stopped", {})
    events.write(record)
    events.write(record._replace(log_ns=record.log_ns + 1_250_000_000))
    events.write(record._replace(severity=Severity.DEBUG, text="nobody reads this"))
    err.cache_clear()
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["    0.00  safety: stopped", "    1.25  safety: stopped"]


def test_plain_lines_report_the_state_of_the_run_every_few_seconds(
    capsys: pytest.CaptureFixture[str],
) -> None:
    err.cache_clear()
    events = EventLines(NullSink(), plain=True)
    events.status = lambda: status_line(host().snapshot())
    record = EventRecord(0, Severity.DEBUG, "link", "nothing", "nobody reads this", {})
    for tenth in range(121):
        events.write(record._replace(log_ns=tenth * 100_000_000))
    err.cache_clear()
    lines = capsys.readouterr().err.splitlines()
    assert [line.split()[0] for line in lines] == ["5.00", "10.00"]
    for part in ("run waiting", "stop operator", "faults battery_low", "15.50 V"):
        assert part in lines[0], part


def test_text_of_a_device_cannot_act_on_the_terminal() -> None:
    hostile = "\x1b]52;c;aGk=\x07\x9b2J\u202e\u200b\n[bold]end"
    events = EventLines(NullSink(), plain=False)
    events.write(LogRecord(0, Severity.INFO, "device\x1b[2J", hostile))
    out = io.StringIO()
    console = VisibleConsole()
    console.file = out
    console.print(Dashboard(host().snapshot, events).layout(140, 42), height=42)
    assert all(c == "\n" or is_visible(c) for c in out.getvalue())
    assert "\\x1b]52;c;aGk=\\x07\\x9b2J\\u202e\\u200b\\n[bold]end" in out.getvalue()


def test_keys_fit_their_line() -> None:
    class Loop:
        host = None

    operator = Operator(MODEL, DeadManSwitch(0.3, 0.15))
    keys = Operating(Loop(), operator, on_resume=lambda: None)  # type: ignore[arg-type]  # only help is used
    for width in (58, 60, 80, 120):
        assert len(keys.help(width)) <= width
        assert "STOP" in keys.help(width)
    assert keys.help(30).startswith("space STOP"), "the text is cut at its end"
    operator.take_over()
    for width in (58, 60, 80, 120):
        assert len(keys.help(width)) <= width
        assert "STOP" in keys.help(width)
        assert "tap" in keys.help(width)
        assert "0.10 m/s" in keys.help(width), "the speed of a key press is always low"


@pytest.mark.parametrize(("columns", "lines"), [("65535", "65535"), ("9" * 30, "1")])
def test_a_terminal_that_reports_any_size_is_filled_as_far_as_a_screen_reaches(
    columns: str, lines: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    monkeypatch.setenv("LINES", lines)
    console = VisibleConsole(stderr=True)
    assert console.size == (MAX_COLUMNS, min(int(lines), MAX_ROWS))
    assert console.options.max_width == MAX_COLUMNS
    console.file = io.StringIO()
    console.print(Screen(Dashboard(host().snapshot, EventLines(NullSink(), plain=False))))
    assert len(console.file.getvalue()) < 5 * MAX_COLUMNS * MAX_ROWS
