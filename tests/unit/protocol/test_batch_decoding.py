"""Conversion of captures to arrays: columns, physical values, sources and memory use."""

from __future__ import annotations

import io
import math
import tracemalloc
from typing import TYPE_CHECKING

import numpy as np
import pytest

from protocol.messages.device import Encoders, Hello, Imu, LogText, Range
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.batch import BatchDecoder, decode_capture, iter_capture, row_dtype
from protocol.uart.framing import Damage, encode_frame
from protocol.uart.link import Link

if TYPE_CHECKING:
    from collections.abc import Iterator

    from protocol.schema.message import Message, MessageSpec

MIB = 1 << 20


def capture(*messages: Message) -> bytes:
    link = Link(Direction.DEVICE)
    for index, message in enumerate(messages):
        link.send(message, 1000 * index, node=3, flags=2)
    return link.data_to_send()


@pytest.mark.parametrize("spec", CATALOGUE.specs, ids=lambda s: s.name)
def test_every_message_has_columns_for_header_and_fields(spec: MessageSpec) -> None:
    names = row_dtype(spec).names
    assert names == ("offset", "frame_flags", "node", "seq", "t_us", *(f.name for f in spec.fields))


def test_rows_carry_place_header_and_fields() -> None:
    first, second = Encoders(left=1, right=0xFFFF), Encoders(left=0, right=2)
    data = capture(first, Imu(1, 2, 3, 4, 5, 6, -7), second)
    rows = decode_capture(data).messages["encoders"]
    assert rows.tolist() == [
        (1, 2, 3, 0, 0, 1, 0xFFFF),
        (data.rfind(b"\0", 0, -1) + 1, 2, 3, 2, 2000, 0, 2),
    ]
    assert decode_capture(data).messages["imu"]["gyro_z"].tolist() == [-7]


def test_physical_values_with_nothing_there_as_nan() -> None:
    result = decode_capture(
        capture(
            Range(
                ultrasonic=1500,
                infrared_left=255,
                infrared_right=40,
                contacts=0,
                ultrasonic_age=255,
            ),
            Range(
                ultrasonic=0xFFFF, infrared_left=0, infrared_right=40, contacts=0, ultrasonic_age=61
            ),
        )
    )
    assert result.si("range", "ultrasonic")[0] == pytest.approx(1.5)
    assert [math.isnan(v) for v in result.si("range", "infrared_left")] == [True, False]
    assert [math.isnan(v) for v in result.si("range", "ultrasonic")] == [False, True]
    assert result.si("imu", "gyro_z").shape == (0,)


def test_texts_are_strings_and_ids_are_bytes() -> None:
    hello = Hello(1, bytes(range(12)), 2, 3, 0, 5, 1, 2, 3, "sweeper")
    result = decode_capture(capture(LogText(1, "grün"), hello, LogText(2, "")))
    assert result.messages["log_text"]["line"].tolist() == ["grün", ""]
    assert result.messages["hello"]["uid"].tolist() == [bytes(range(12))]
    assert result.messages["hello"]["name"].tolist() == ["sweeper"]


def test_a_stretch_of_many_chunks_is_one_damage_where_it_began() -> None:
    data = capture(Encoders(1, 2)) + b"\x11" * 5000 + capture(Encoders(3, 4))
    result = decode_capture(data, chunk_bytes=100)
    ((offset, length, damage),) = result.damaged.tolist()
    assert (offset, length) == (data.index(b"\x11" * 5000), 5000)
    assert result.damage_of(damage) is Damage.LENGTH
    assert result.messages["encoders"]["left"].tolist() == [1, 3]


def big_capture(size: int) -> Iterator[bytes]:
    rng = np.random.default_rng(1)
    frames = [b"\0" + encode_frame(1, 0x13, i, i, rng.bytes(14)) for i in range(1000)]
    block = b"".join(frames) + rng.bytes(200) + b"\x11" * 100_000
    for _ in range(size // len(block)):
        yield block


def test_memory_depends_on_the_chunk_and_not_on_the_capture() -> None:
    peaks = []
    for size in (4 * MIB, 32 * MIB):
        tracemalloc.start()
        try:
            count = sum(
                r.message_count for r in iter_capture(big_capture(size), chunk_bytes=MIB // 2)
            )
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
        assert count > size // 200
    assert max(peaks) < 8 * MIB
    assert peaks[1] < peaks[0] * 1.2


def test_endless_garbage_is_not_kept() -> None:
    decoder = BatchDecoder()
    tracemalloc.start()
    try:
        for _ in range(16):
            decoder.feed(b"\x11" * MIB)
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 100_000
    result = decoder.feed(b"\0" + encode_frame(1, 0x16, 0, 0, bytes(4)))
    assert result.damaged.tolist() == [(0, 16 * MIB, 1)]
    assert result.messages["encoders"]["offset"].tolist() == [16 * MIB + 1]


def test_an_empty_capture_of_any_kind_holds_nothing() -> None:
    for source in (b"", io.BytesIO(), [], [b""]):
        result = decode_capture(source)
        assert (result.message_count, len(result.damaged), result.bytes_seen) == (0, 0, 0)
        assert set(result.messages) == set(CATALOGUE.by_name)
