"""``sweepctl bringup`` as users run it, on a correctly wired virtual sweeper."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import pytest

from bridge.convert.redecode import compare
from bridge.record.reader import LogReader
from support.cli import sweepctl
from support.served import Served

if TYPE_CHECKING:
    from pathlib import Path

    from support.processes import Done


pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("target")]


def bringup(monkeypatch: pytest.MonkeyPatch, answers: str, *arguments: str | Path) -> Done:
    monkeypatch.setattr("sys.stdin", io.StringIO(answers))
    return sweepctl("bringup", *arguments)


def test_it_asks_before_it_turns_a_wheel_and_reports_the_result(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with Served() as served:
        plant = served.device.plant
        steps = ("--step", "supply", "--step", "motors", "--step", "control")
        declined = bringup(monkeypatch, "n\nn\n", served.port, *steps)
        assert declined.status == 0
        assert "motors: skipped: the wheels are not free to turn" in declined.err
        assert plant.wheel_angles_rad == (0.0, 0.0)
        assert declined.out == "0 of 4 checks failed, 2 skipped\n"

        plant.faults.lifted = True  # the robot is on a stand
        wrong = "y\ny\nrf\ny\nrf\n"  # the person reports the RIGHT wheel for both outputs
        found = bringup(monkeypatch, wrong, served.port, "--step", "motors", "--json")
        assert found.status == 1
        printed = {f["step"]: f["text"] for f in found.json["findings"] if f["ok"] is False}
        assert printed["motors"] == "left and right are swapped"
        assert plant.wheel_angles_rad[0] > 1.0

        plot = tmp_path / "step.png"
        asked = ("--step", "control", "--json", "--plot", plot)
        log = tmp_path / "bench.mcap"
        stepped = bringup(monkeypatch, "y\n", served.port, *asked, "--log", log)
        assert stepped.status == 0
        assert [s["wheel"] for s in stepped.json["wheel_steps"]] == ["left", "right"]
        assert plot.read_bytes()[:4] == b"\x89PNG"
        assert "+0.150" in stepped.err, "and drawn in characters"
        stood = plant.wheel_angles_rad
        for name, status in (("step.png", 1), ("step.txt", 2)):
            kept = ("--step", "control", "--plot", tmp_path / name)
            rejected = bringup(monkeypatch, "y\n", served.port, *kept)
            assert rejected.status == status
            assert str(tmp_path / name) in rejected.line
        assert plant.wheel_angles_rad == stood, "told before a wheel turns"

        recorded = compare(log)
        assert recorded.same, recorded.first
        assert recorded.recorded > 200
        reader = LogReader(log)
        assert reader.run["command"] == "bringup"
        reported = [
            m.decoded.text for m in reader.messages({"/events"}) if m.decoded.kind == "printed"
        ]
        assert reported
        assert all(text in stepped.err for text in reported)
        again = bringup(monkeypatch, "", served.port, "--step", "rest", "--log", log)
        assert again.status == 1
        assert "exists; give another name, or --force" in again.line


def test_what_cannot_be(monkeypatch: pytest.MonkeyPatch) -> None:
    assert bringup(monkeypatch, "", "/dev/none-such").status == 3
    assert bringup(monkeypatch, "", "/dev/none-such", "--step", "dance").status == 2
