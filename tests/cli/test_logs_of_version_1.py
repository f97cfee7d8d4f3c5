"""Every command still reads logs of sweepctl 0.1 with protocol version 1."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from bridge.record.reader import LogReader
from bridge.replay.device import load
from protocol.imu import NOMINAL
from protocol.messages.device import Imu, Range
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.codec import Codec
from support.cli import sweepctl
from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

LOGS = ROOT / "tests" / "vectors" / "logs-0.1"
pytestmark = pytest.mark.slow


@pytest.fixture(params=["uart", "can"])
def log(request: pytest.FixtureRequest) -> Path:
    path: Path = LOGS / f"{request.param}.mcap"
    return path


def test_info(log: Path) -> None:
    done = sweepctl("info", log)
    assert done.status == 0
    assert "/device/imu" in done.out
    assert "0.1.0" in done.out


def test_doctor_reads_the_raw_bytes(log: Path) -> None:
    done = sweepctl("doctor", log, "--json")
    found = json.loads(done.out)
    assert "version" not in {f["kind"] for f in found["findings"]}
    assert found["figures"]["frames"] > 500
    assert (found["figures"]["lost"], found["figures"]["damaged"]) == (0, 0)


@pytest.mark.parametrize("command", ["report", "export", "recover"])
def test_report_export_and_recover(log: Path, tmp_path: Path, command: str) -> None:
    out = {"report": "r.html", "export": "tables", "recover": "r.mcap"}[command]
    done = sweepctl(command, log, "--out", tmp_path / out)
    assert done.status == 0, done.err
    assert (tmp_path / out).exists()


def test_view_converts_it(log: Path, tmp_path: Path) -> None:
    done = sweepctl("view", log, "--save", tmp_path / "run.rrd")
    assert done.status == 0, done.err
    assert (tmp_path / "run.rrd").stat().st_size > 10_000


def test_a_replay_has_the_content_of_the_log(log: Path) -> None:
    reader = LogReader(log)
    recording = load(reader)
    assert recording.imu_info == NOMINAL.info()
    assert recording.hello.name == "virtual sweeper"
    codec = Codec()
    for cls, topic in ((Imu, "/device/imu"), (Range, "/device/range")):
        spec = CATALOGUE.spec(cls)
        played = [
            codec.decode(spec, p.payload)
            for p in recording.played
            if p.type_id == spec.type_id and not p.is_damaged
        ]
        logged = [m.decoded for m in LogReader(log).messages(frozenset({topic}))]
        assert len(played) == len(logged) > 10
        name = spec.fields[0].name
        assert [getattr(p, name) for p in played] == [getattr(d, name) for d in logged]
