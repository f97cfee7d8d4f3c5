"""Comparison of PROTOCOL.md with the wire format and with the code."""

from __future__ import annotations

import importlib
import json
import re
import zlib
from typing import TYPE_CHECKING, Any

import pytest

from bridge.session.states import TRANSITIONS
from protocol.generate import render
from protocol.generate.md import Machine, diagram
from protocol.messages.device import Imu, Range
from protocol.messages.host import VelocitySetpoint
from protocol.schema.catalogue import CATALOGUE
from support import reference_codec as ref
from support.peers import catalogue, longer
from support.root import ROOT
from tools.dev.behaviour import wire_behaviour

if TYPE_CHECKING:
    from collections.abc import Iterator

COMMITTED = ROOT / "docs" / "protocol" / "PROTOCOL.md"
TEXT = render("md", behaviour=wire_behaviour())["PROTOCOL.md"]


ARROW = re.compile(r"^    (\w+) --> (\w+): (.+)$", re.MULTILINE)


def rows(text: str, first: str) -> list[list[str]]:
    """Return the cells of the first table whose header row begins with this cell."""
    lines = iter(text.splitlines())
    for line in lines:
        if line.startswith(f"| {first} |"):
            next(lines)
            return list(_cells(lines))
    raise AssertionError(f"no table {first!r}")


def _cells(lines: Iterator[str]) -> Iterator[list[str]]:
    for line in lines:
        if not line.startswith("|"):
            return
        yield [c.strip().replace("\\|", "|") for c in re.split(r"(?<!\\)\|", line)[1:-1]]


def section(title: str, text: str = TEXT) -> str:
    found = re.split(rf"^##+ {re.escape(title)}$", text, flags=re.MULTILINE)
    assert len(found) == 2, title
    return re.split(r"^##+ ", found[1], flags=re.MULTILINE)[0]


def test_committed_pages_match_the_code() -> None:
    fresh = COMMITTED.read_text(encoding="utf-8") == TEXT
    assert fresh, "stale; run: sweepctl generate md --force --out docs/protocol"


def test_it_follows_the_catalogue() -> None:
    other = render("md", catalogue(less=[Range], more=[longer(Imu, "pressure")]))["PROTOCOL.md"]
    assert "### range" not in other
    assert "`pressure`" in section("imu", other)
    assert "## States" not in other, "the call gives no behaviour, so the page has none"


def test_every_link_leads_somewhere() -> None:
    titles = re.findall(r"^##+ (.+)$", TEXT, flags=re.MULTILINE)
    anchors = {re.sub(r"[^\w -]", "", t.lower()).replace(" ", "-") for t in titles}
    assert len(anchors) == len(titles), "headings are unique"
    assert set(re.findall(r"\]\(#([^)]+)\)", TEXT)) <= anchors


def vectors() -> list[dict[str, Any]]:
    folder = ROOT / "tests" / "vectors"
    return [
        vector
        for name in ("messages", "edges")
        for vector in json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
        if not vector.get("decode_only")
    ]


def read_by_table(name: str, payload: bytes) -> tuple[dict[str, object], dict[str, float]]:
    """Return raw and physical values, decoded only with the table of the message in the page."""
    raw: dict[str, object] = {}
    physical: dict[str, float] = {}
    text = section(name)
    table = [] if "No payload." in text else rows(text, "offset")
    for offset, field, wire, step, *_ in table:
        field_name, start = field.strip("`"), int(offset)
        if wire == "text":
            raw[field_name] = payload[start:].decode()
        elif wire == "uid96":
            raw[field_name] = payload[start : start + 12].hex()
        else:
            size = int(wire[1:]) // 8
            taken = payload[start : start + size]
            value = int.from_bytes(taken, "little", signed=wire[0] == "i")
            raw[field_name] = value
            if step:
                scale, _, offset_text = step.partition(", 0 is ")
                gain = eval(scale.split(" ≈ ")[0])  # noqa: S307 - a fraction of our own document
                physical[field_name] = value * gain + float(offset_text or 0)
    return raw, physical


@pytest.mark.parametrize("vector", vectors(), ids=lambda v: str(v["name"]))
def test_the_tables_alone_decode_the_vectors(vector: dict[str, Any]) -> None:
    raw, physical = read_by_table(vector["message"], bytes.fromhex(vector["payload"]))
    assert raw == vector["raw"]
    for name, value in vector["si"].items():
        field = max((f for f in physical if name.startswith(f + "_")), key=len)
        if value is not None and not name.startswith(
            "gyro"
        ):  # the wire has degrees, the vector radians
            assert physical[field] == pytest.approx(value, rel=1e-9), name


def test_every_message_is_listed_with_its_size() -> None:
    listed = {int(r[0], 16): r for r in rows(section("Messages"), "type")}
    assert set(listed) == set(ref.LAYOUTS)
    for type_id, (name, sender, fields) in ref.LAYOUTS.items():
        row = listed[type_id]
        size = sum(ref.SIZES.get(f[1], 0) for f in fields)
        text = " + text" if any(f[1] == "text" for f in fields) else ""
        assert (row[1], row[2], row[5]) == (f"[`{name}`](#{name})", sender, f"{size} B{text}")


def test_every_native_can_frame_fits_and_has_its_own_identifier() -> None:
    table = rows(section("Classic CAN"), "identifier, node 1")
    assert len({r[0] for r in table}) == len(table)
    carried: dict[str, set[str]] = {}
    for identifier, message, layout, _ in table:
        cells = re.findall(r"(\d) `(\w+)`", layout)
        assert sum(int(size) for size, _ in cells) <= 8
        assert int(identifier, 16) <= 0x7FF
        name = message.split("`")[1]
        carried.setdefault(name, set()).update(n for _, n in cells if n not in {"t16", "t_us"})
    for name, fields in carried.items():
        assert fields == {f.name for f in CATALOGUE.by_name[name].fields}


def test_the_hashes_can_be_worked_out_by_the_rule_in_the_text() -> None:
    part = section("Schema negotiation")
    value = 0
    for hashed, printed in rows(part, "hashed text"):
        value = zlib.crc32(f"{hashed.strip('`')}\n".encode(), value)
        assert f"{value:08x}" == printed
    last = {r[0].strip("`"): r[3] for r in rows(part, "message")}
    assert f"{value:08x}" == last["stop"]
    types = {name: type_id for type_id, (name, _, _) in ref.LAYOUTS.items()}
    lines = sorted(f"{types[name]:02x}:{chain}\n" for name, chain in last.items())
    lines += [f"{r[2]}:{r[3]}\n" for r in sorted(rows(part, "enumeration"))]
    assert f"`{zlib.crc32(''.join(lines).encode()):08x}`" in part


def arrows(title: str) -> set[tuple[str, str, str]]:
    return {
        (start, label.strip(), end)
        for start, end, labels in ARROW.findall(section(title))
        for label in labels.split(",")
    }


def test_the_session_diagram_matches_the_table() -> None:
    drawn = arrows("The host's session")
    assert drawn == {(o.value, w, n.value) for (o, w), n in TRANSITIONS.items() if o is not n}


def test_the_device_drives_only_from_an_open_latch() -> None:
    drawn = arrows("The device's modes")
    leave = {what.split(" (")[0]: end for start, what, end in drawn if start == "stopped"}
    assert leave == {"clear_stop": "idle", "supply lost": "off", "reset": "boot"}
    free = ("idle", "velocity", "bringup", "onboard", "running", "paused")
    for state in free:
        for what in ("stop", "host silent", "hello of another session"):
            assert (state, what, "stopped") in drawn
    into = {start for start, what, _ in drawn if what.startswith("planner start")}
    assert into == {"onboard"}


def test_a_graver_cause_is_never_replaced_by_a_lesser_one() -> None:
    order = ["free", "session_end", "link", "supervise", "operator", "hardware"]
    for start, what, end in arrows("The device's latch"):
        if what.startswith("stop"):
            assert order.index(end) > order.index(start)
        else:
            assert (what, end) == (f"clear {start}", "free")


def test_moves_between_two_states_share_an_arrow() -> None:
    machine = Machine("m", "", "a", [("a", "x", "b"), ("b", "y", "a"), ("a", "z", "b")])
    assert list(diagram(machine)) == [
        "stateDiagram-v2",
        "    [*] --> a",
        "    a --> b: x, z",
        "    b --> a: y",
    ]


def test_every_timing_rule_names_a_constant_that_exists() -> None:
    sources = [r[3].strip("`") for r in rows(section("Timing"), "side")]
    assert len(sources) > 20
    for source in sources:
        module, _, name = source.rpartition(".")
        assert isinstance(getattr(importlib.import_module(module), name), int | float), source


def test_the_motor_command_in_the_text_is_a_real_one() -> None:
    life = section("From setpoint to motor")
    (wire,) = re.findall(r"^ +((?:[0-9a-f]{2} ){15,}[0-9a-f]{2})$", life, flags=re.MULTILINE)
    (frame,) = ref.parse_stream(bytes.fromhex(wire))
    assert isinstance(frame, ref.RefFrame)
    values = ref.decode_payload(frame.type_id, frame.payload)
    assert values == {"v": 2000, "yaw_rate": -500, "time_to_live": 200, "counter": 7}
    assert f"payload is `{frame.payload.hex(' ')}`" in life
    assert frame.type_id == CATALOGUE.by_class[VelocitySetpoint].type_id
    t16 = (frame.t_us >> 4 & 0xFFFF).to_bytes(2, "little")
    assert f"{t16.hex(' ')} {frame.payload.hex(' ')}" in life
