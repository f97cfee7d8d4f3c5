"""The shared test vectors, checked with the codec and with the independent reference codec."""

from __future__ import annotations

import json
from typing import Any

import pytest

from protocol.link import Received, Rejected
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.codec import Codec
from protocol.schema.message import Direction
from protocol.uart.framing import DamagedFrame, Frame, UartParser, encode_frame
from protocol.uart.link import Link
from support import reference_codec as ref
from support.root import ROOT

Vector = dict[str, Any]


def load(name: str) -> list[Vector]:
    path = ROOT / "tests" / "vectors" / f"{name}.json"
    vectors: list[Vector] = json.loads(path.read_text(encoding="utf-8"))
    return vectors


def named(vector: Vector) -> str:
    return str(vector["name"])


INTACT = load("messages") + load("edges")


def wire_value(value: object, kind: str) -> object:
    return bytes.fromhex(value) if kind == "uid96" and isinstance(value, str) else value


def raw_values(vector: Vector) -> dict[str, object]:
    rows = ref.LAYOUTS[vector["header"]["type"]][2]
    return {row[0]: wire_value(vector["raw"][row[0]], row[1]) for row in rows}


def assert_close(values: dict[str, float | None], expected: dict[str, float | None]) -> None:
    assert set(values) == set(expected)
    for name, value in expected.items():
        wanted = None if value is None else pytest.approx(value, rel=1e-9)
        assert values[name] == wanted, name


def header(frame: Frame | ref.RefFrame) -> dict[str, int]:
    return {
        "version": frame.version,
        "flags": frame.flags,
        "node": frame.node,
        "type": frame.type_id,
        "seq": frame.seq,
        "t_us": frame.t_us,
    }


def test_every_message_has_a_vector() -> None:
    assert {v["message"] for v in load("messages")} == {s.name for s in CATALOGUE}


def test_the_reference_crc_is_that_of_the_published_check_value() -> None:
    assert ref.crc32(b"123456789") == 0xCBF43926


@pytest.mark.parametrize(
    ("plain", "coded"),
    [
        ("", "01"),
        ("00", "01 01"),
        ("00 00", "01 01 01"),
        ("11 22 00 33", "03 11 22 02 33"),
        ("11 22 33 44", "05 11 22 33 44"),
        ("11 00 00 00", "02 11 01 01 01"),
    ],
)
def test_the_reference_cobs_is_that_of_the_paper_s_examples(plain: str, coded: str) -> None:
    assert ref.cobs_encode(bytes.fromhex(plain)) == bytes.fromhex(coded)
    assert ref.cobs_decode(bytes.fromhex(coded)) == bytes.fromhex(plain)


@pytest.mark.parametrize("vector", INTACT, ids=named)
def test_intact_vector_decodes(vector: Vector) -> None:
    data = bytes.fromhex(vector["hex"])
    (frame,) = UartParser().feed(data)
    assert isinstance(frame, Frame)
    assert header(frame) == vector["header"]
    assert frame.payload.hex() == vector["payload"]

    spec = CATALOGUE.by_type[frame.type_id]
    assert spec.name == vector["message"]
    message = Codec().decode(spec, frame.payload)
    assert type(message) is spec.cls
    assert dict(zip([f.name for f in spec.fields], message, strict=True)) == raw_values(vector)

    names = [f.name + f.si_suffix for f in spec.fields if f.si_suffix]
    assert_close({name: getattr(message, name) for name in names}, vector["si"])


@pytest.mark.parametrize("vector", [v for v in INTACT if not v.get("decode_only")], ids=named)
def test_intact_vector_encodes(vector: Vector) -> None:
    head = vector["header"]
    message = CATALOGUE.by_type[head["type"]].cls(**raw_values(vector))
    type_id, payload = Codec().encode(message)
    wire = encode_frame(head["node"], type_id, head["seq"], head["t_us"], payload, head["flags"])
    assert (b"\0" + wire).hex() == vector["hex"]


@pytest.mark.parametrize("vector", INTACT, ids=named)
def test_intact_vector_agrees_with_the_reference_codec(vector: Vector) -> None:
    (frame,) = ref.parse_stream(bytes.fromhex(vector["hex"]))
    assert isinstance(frame, ref.RefFrame)
    assert header(frame) == vector["header"]
    values = ref.decode_payload(frame.type_id, frame.payload)
    assert values == raw_values(vector)
    assert_close(ref.si_values(frame.type_id, values), vector["si"])


@pytest.mark.parametrize("vector", [v for v in load("damaged") if "damage" in v], ids=named)
def test_damaged_vector_is_located_and_named(vector: Vector) -> None:
    data = bytes.fromhex(vector["hex"])
    (event,) = UartParser().feed(data)
    assert isinstance(event, DamagedFrame)
    expected = (vector["damage"], vector["offset"], vector["length"])
    assert (event.damage.value, event.offset, event.length) == expected
    assert event.data == data[event.offset : event.offset + min(event.length, 254)]
    assert ref.parse_stream(data) == [
        ref.RefDamage(vector["offset"], vector["length"], vector["damage"])
    ]


@pytest.mark.parametrize("vector", [v for v in load("damaged") if "rejected" in v], ids=named)
def test_unusable_vector_is_rejected_with_its_reason(vector: Vector) -> None:
    receiver = {"device": Direction.HOST, "host": Direction.DEVICE}[vector["sent_by"]]
    link = Link(receiver)
    (event,) = link.receive(bytes.fromhex(vector["hex"]))
    assert isinstance(event, Rejected)
    assert event.reason == vector["rejected"]
    assert header(event.frame) == vector["header"]
    assert link.statistics.rejected == 1


@pytest.mark.parametrize("step", [1, 2, 7, 10_000])
@pytest.mark.parametrize("vector", load("streams"), ids=named)
def test_stream_vector_gives_its_events(vector: Vector, step: int) -> None:
    data = bytes.fromhex(vector["hex"])
    link = Link(Direction.HOST)
    got: list[dict[str, object]] = []
    for start in range(0, len(data), step):
        for event in link.receive(data[start : start + step]):
            if isinstance(event, Received):
                got.append({"frame": {"type": event.spec.type_id, "seq": event.frame.seq}})
            else:
                assert isinstance(event, DamagedFrame)
                where = {"offset": event.offset, "length": event.length}
                got.append({"damage": event.damage.value, **where})
    expected = [
        {k: v for k, v in e.items() if "frame" not in e or k == "frame"} for e in vector["events"]
    ]
    assert got == expected
    reported = [e.offset for e in ref.parse_stream(data)]
    assert reported == [e["offset"] for e in vector["events"]]
