"""``sweepctl doctor`` as users run it: on logs of any program, on a port, without a target."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

import pytest
from mcap.writer import Writer

from protocol.messages.device import Hello
from protocol.messages.values import ResetCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.link import Link
from support.cli import end, start, sweepctl

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("doctor")


@pytest.fixture(scope="module")
def noisy(folder: Path) -> Path:
    log = folder / "noisy.mcap"
    fault = "bit-flips@4:3:rate=0.002,way=up"
    sweepctl("simulate", "case-1", "--max-time", "4", "--fault", fault, "--out", log, "--json")
    return log


def test_a_log_with_noise_on_the_line(noisy: Path) -> None:
    done = sweepctl("doctor", noisy, "--json")
    assert done.status == 1
    report = done.json
    assert (report["kind"], report["healthy"], report["exit_status"]) == ("log", False, 1)
    (finding,) = report["findings"]
    assert finding["kind"] == "line_noise"
    assert finding["severity"] == "warning"
    assert "cable" in finding["advice"]
    assert report["figures"]["damaged"] == finding["data"]["damaged"] > 3
    assert report["figures"]["streams"]["imu"]["rate_hz"] == pytest.approx(100, rel=0.1)


def test_the_same_for_people(noisy: Path) -> None:
    done = sweepctl("doctor", noisy)
    assert done.status == 1
    assert "warning line noise: " in done.out
    assert "what to do: shorten and shield the cable" in done.out
    assert "Traceback" not in done.out + done.err
    assert "\x1b" not in done.out


def test_a_log_cut_short_is_read_and_reported(noisy: Path, folder: Path) -> None:
    cut = folder / "cut.mcap"
    cut.write_bytes(noisy.read_bytes()[: noisy.stat().st_size * 3 // 4])
    kinds = [finding["kind"] for finding in sweepctl("doctor", cut, "--json").json["findings"]]
    assert "truncated" in kinds
    assert "line_noise" in kinds


def test_a_log_of_another_program(folder: Path) -> None:
    """Of such a log, ``doctor`` can use only the times of the messages."""
    log = folder / "other.mcap"
    with log.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("anything", "jsonschema", b"{}")
        channel = writer.register_channel("/scan", "json", schema)
        for index in range(200):
            at_ns = index * 100_000_000 + (5_000_000_000 if index >= 120 else 0)
            writer.add_message(channel, at_ns, b"{}", at_ns)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap's own
    report = sweepctl("doctor", log, "--json").json
    reported = {finding["kind"]: finding for finding in report["findings"]}
    assert set(reported) == {"not_recorded", "topic_gap"}
    assert reported["topic_gap"]["data"] == {
        "topic": "/scan",
        "pauses": 1,
        "longest_s": pytest.approx(5.1),
    }
    assert report["exit_status"] == 1


def test_a_note_alone_is_no_trouble(folder: Path) -> None:
    link = Link(Direction.DEVICE)
    capture = folder / "hellos.bin"
    printed = b""
    for second in range(5):
        hello = Hello(CATALOGUE.hash, bytes(12), 1, 5, ResetCause.POWER_ON, 0, 1, 2, 3, "hand")
        link.send(hello, second * 1_000_000, node=1)
        printed += link.data_to_send()
    capture.write_bytes(printed)
    done = sweepctl("doctor", capture)
    assert done.status == 0
    assert "info    waiting: only hellos were received" in done.out
    assert "no problem found" in done.out
    assert sweepctl("doctor", capture, "--json").json["healthy"]


def test_invalid_logs(folder: Path) -> None:
    done = sweepctl("doctor", folder)
    assert done.status == 2
    assert "is a folder" in done.line
    done = sweepctl("doctor", folder / "nothing-here")
    assert done.status == 3
    assert "nothing-here" in done.err
    done = sweepctl("doctor", folder / "gone.mcap")
    assert done.status == 1
    assert "gone.mcap: no such file or port" in done.line


@pytest.mark.parametrize("option", ["--duration", "--node", "--baud"])
def test_an_option_of_a_port_is_rejected_for_a_file(option: str) -> None:
    done = sweepctl("doctor", __file__, option, "9600" if option == "--baud" else "3")
    assert (done.status, f"{option} needs a port" in done.line) == (2, True)


@pytest.mark.parametrize(
    ("file_or_port", "option", "reported"),
    [
        ("can:virtual:x", "--find-baud", "for can:virtual:x give --bitrate"),
        ("socket://127.0.0.1:9", "--find-baud", "socket://127.0.0.1:9 has no baud rate"),
        (__file__, "--find-baud", "is a file"),
        (__file__, "--listen", "is a file"),
        (__file__, "--duration=3", "--duration needs a port"),
        (__file__, "--node=2", "--node needs a port"),
    ],
)
def test_conflicting_options(file_or_port: str, option: str, reported: str) -> None:
    done = sweepctl("doctor", file_or_port, option)
    assert done.status == 2
    assert option.partition("=")[0] in done.line
    assert reported in done.line


def test_a_port_that_is_well_and_one_that_is_silent(folder: Path) -> None:
    link = folder / "sweeper"
    emulator = start("emulate", "case-1", "--pty-link", link, "--seed", "3", cwd=folder)
    try:
        assert emulator.stdout is not None
        assert emulator.stdout.readline().startswith("ready ")
        done = sweepctl("doctor", link, "--duration", "3", "--json")
        report = done.json
        assert report["figures"]["frames"] > 300
        assert report["figures"]["boots"][0]["firmware"].startswith("virtual sweeper")
        # A busy machine causes latency or a stall; other findings are errors.
        assert {f["kind"] for f in report["findings"]} <= {"latency", "host_stall", "gap"}
        silent = sweepctl("doctor", link, "--duration", "2.5", "--listen", "--json").json
        assert silent["figures"]["bytes"]["out"] == 0
        assert "hello" in silent["figures"]["streams"], "the device has a host"
    finally:
        assert end(emulator, signal.SIGTERM).status == 0
