"""The raw bytes of a log, decoded again, give the recorded messages bit for bit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.convert.redecode import compare
from bridge.record.errors import LogReadError
from bridge.record.reader import LogReader
from support.cli import end, short_runs, start, sweepctl
from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

    from support.processes import Done

pytestmark = pytest.mark.slow


def test_a_simulated_run(tmp_path_factory: pytest.TempPathFactory) -> None:
    for run in short_runs(tmp_path_factory):
        result = compare(run.log)
        assert result.recorded > 2000
        assert (result.equal, result.differing) == (result.recorded, {}), result.first


def test_a_run_on_a_bad_line(tmp_path: Path) -> None:
    """The serial line damages and loses frames, and the device reboots.

    When the session processes the recorded bytes again, its results are equal.
    """
    log = tmp_path / "bad.mcap"
    done = sweepctl(
        *("simulate", "empty", "--planner", "u-shape", "--max-time", "20", "--out", log, "--json"),
        *("--fault", "bit-flips@3:6:rate=0.0005,way=up", "--fault", "reset@12"),
    )
    assert done.status == 5, done.err  # the device's reset stopped the run
    assert done.json["wire"]["crc_errors"] > 0
    result = compare(log)
    assert result.recorded > 1500
    assert (result.equal, result.differing) == (result.recorded, {}), result.first


@pytest.mark.realtime
@pytest.mark.parametrize("link", ["pty", "slcan"])
def test_a_live_run(tmp_path: Path, link: str) -> None:
    emulator = start("emulate", "empty", "--link", link, "--seed", "3", cwd=tmp_path)
    try:
        assert emulator.stdout is not None
        port = emulator.stdout.readline().split(maxsplit=1)[1].strip()
        host: Done = end(
            start("connect", port, "--duration", "3", "--out", "run.mcap", cwd=tmp_path)
        )
    finally:
        emulator.terminate()
        emulator.communicate()
    assert host.status == 0, host.err
    result = compare(tmp_path / "run.mcap")
    assert result.recorded > 300
    assert (result.equal, result.differing) == (result.recorded, {}), result.first


def test_a_difference_is_reported(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    """The test changes one bit of a recorded message, which the wire's CRC does not protect."""
    from mcap.writer import Writer  # noqa: PLC0415 - used here only

    log, changed = short_runs(tmp_path_factory)[0].log, tmp_path / "changed.mcap"
    reader = LogReader(log)
    with changed.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels: dict[str, int] = {}
        schemas = {m.topic: m.channel for m in reader.messages()}
        for metadata, values in reader.metadata.items():
            writer.add_metadata(metadata, values)
        raw_schema = _schemas(log)
        for topic, channel in schemas.items():
            name, encoding, data = raw_schema[topic]
            schema = writer.register_schema(name, encoding, data)
            channels[topic] = writer.register_channel(topic, channel.message_encoding, schema)
        seen = 0
        for topic, log_ns, publish_ns, sequence, data in (
            (m.topic, *m[1:]) for m in reader.messages()
        ):
            seen += topic == "/device/imu"
            wrong = topic == "/device/imu" and seen == 100
            content = data[:-1] + bytes([data[-1] ^ 1]) if wrong else data
            writer.add_message(channels[topic], log_ns, content, publish_ns, sequence)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    result = compare(changed)
    assert result.differing == {"/device/imu": 1}
    assert result.first == "/device/imu: message 99 differs in content"


def _schemas(log: Path) -> dict[str, tuple[str, str, bytes]]:
    from mcap.reader import make_reader  # noqa: PLC0415 - used here only

    with log.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    found = summary.schemas
    return {
        c.topic: (found[c.schema_id].name, found[c.schema_id].encoding, found[c.schema_id].data)
        for c in summary.channels.values()
    }


def test_no_log(tmp_path: Path) -> None:
    with pytest.raises(LogReadError):
        compare(tmp_path / "none.mcap")


def test_the_bytes_of_version_0_1_cannot_be_compared() -> None:
    with pytest.raises(LogReadError, match=r"of version 0\.1"):
        compare(ROOT / "tests" / "vectors" / "logs-0.1" / "uart.mcap")
