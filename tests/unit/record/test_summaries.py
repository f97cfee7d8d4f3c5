"""The summary in a log: read completely if sweepctl wrote it, else only the valid values."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
from mcap.writer import Writer

from bridge.record.summaries import is_run, read_summary
from support.cli import sweepctl

if TYPE_CHECKING:
    from pathlib import Path

RUN: dict[str, Any] = {
    "room": "empty",
    "planner": None,
    "seed": 3,
    "outcome": "complete",
    "reason": "done",
    "duration_s": 12.5,
    "path_m": None,
    "turns": 2,
    "collisions": 0,
    "contact_s": 0.0,
    "energy_wh": None,
    "pose_error_m": {"end": None, "max": 0.01},
    "coverage": dict.fromkeys(
        ("mouth_sweepable", "mouth_free", "body_reachable", "body_free", "eq8"), 0.9
    ),
    "t90_s": None,
    "t99_s": None,
    "largest_hole_cm2": 4.0,
    "wire": {
        "frames": {"rx": 1, "tx": 2},
        "bytes": {"rx": 3, "tx": 4},
        "lost": 0,
        "crc_errors": 0,
    },
    "log": "a.mcap",
    "later": [1, {"anything": True}],
}


def test_our_own_messages_are_read_unchanged() -> None:
    found = read_summary(json.dumps(RUN).encode())
    assert found == RUN
    assert is_run(RUN)


@pytest.mark.parametrize(
    ("key", "reported"),
    [
        ("outcome", 5),
        ("duration_s", "long"),
        ("turns", True),
        ("coverage", 3),
        ("coverage", {"mouth_sweepable": "all"}),
        ("coverage", None),
        ("wire", []),
        ("wire", {"frames": 7}),
        ("wire", {"bytes": {"rx": "many"}}),
        ("pose_error_m", {"end": []}),
    ],
)
def test_another_kind_of_value_is_ignored(key: str, reported: object) -> None:
    found = read_summary(json.dumps({**RUN, key: reported}).encode())
    assert found == {name: value for name, value in RUN.items() if name != key}
    assert not is_run(found)


def test_numbers_that_no_json_has_are_null() -> None:
    found = read_summary(b'{"duration_s": NaN, "path_m": 1e999, "x": [-Infinity, 1.5]}')
    assert found == {"duration_s": None, "path_m": None, "x": [None, 1.5]}


@pytest.mark.parametrize("data", [b"", b"[1]", b"3", b"\xff\xfe", b"{", b"[" * 100_000])
def test_a_value_that_is_no_object_gives_none(data: bytes) -> None:
    assert read_summary(data) is None


def test_a_log_of_another_program_with_such_an_attachment_is_read(tmp_path: Path) -> None:
    log = tmp_path / "other.mcap"
    with log.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for topic in ("/raw/uart/rx", "/raw/can", "/events", "/device/imu"):
            writer.add_message(writer.register_channel(topic, "json", 0), 1, b"{}", 1)
        other = b'{"outcome": "complete", "coverage": {"mouth_sweepable": 1e999}, "wire": 1}'
        writer.add_attachment(0, 0, "summary.json", "application/json", other)
        writer.add_metadata("sweepctl", {"clock_offset_ns": "none", "seed": "x"})
        writer.add_metadata("device", {"node": "first"})
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    assert sweepctl("info", log).status == 0
    assert sweepctl("info", log, "--json").json["outcome"] == "complete"
    assert sweepctl("diff", log, log, "--json").status == 0
    checked = sweepctl("replay", log, "--check", "--json")
    assert (checked.status, checked.json["same"]) == (1, False)
    assert "no raw bytes of a robot" in sweepctl("replay", log, "--link", "pty").line
    assert sweepctl("view", log, "--png", tmp_path / "a.png").status == 0
