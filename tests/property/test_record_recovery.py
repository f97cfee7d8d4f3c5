"""Whatever the damage, ``recover`` makes a file that the mcap library reads completely."""

from __future__ import annotations

import random
from collections import Counter

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from support.damaged_logs import MAGIC, Log, check_flip, contents, flipped, logs, recovered

pytestmark = pytest.mark.slow

NAMES = [log.name for log in logs()]
_HEAD_BITS = 8 * len(MAGIC)


def named(name: str) -> Log:
    return next(log for log in logs() if log.name == name)


@pytest.mark.parametrize("name", NAMES)
def test_one_bit_costs_at_most_its_chunk(name: str) -> None:
    log = named(name)
    bits = random.Random(name).sample(range(_HEAD_BITS, 8 * len(log.data)), 60)
    for bit in bits:
        check_flip(log, bit)


@pytest.mark.parametrize("name", NAMES)
def test_one_bit_of_any_record_s_head_costs_at_most_its_chunk(name: str) -> None:
    """Opcodes and lengths determine how everything after them is read."""
    log = named(name)
    places = [begin for begin, _, _ in log.chunks] + [end for _, end, _ in log.chunks]
    places += [log.data.find(b"notes") - 29, log.data.rfind(b"made") - 13]
    rng = random.Random(name)
    for place in sorted(set(places[:8] + places[-6:])):
        if place > len(MAGIC):
            for bit in rng.sample(range(8 * place, 8 * place + 72), 3):
                check_flip(log, bit)


cuts = st.lists(
    st.tuples(
        st.sampled_from(["flip", "gap", "zeros", "insert", "cut"]),
        st.floats(0, 1, exclude_max=True),
        st.integers(1, 900),
    ),
    min_size=1,
    max_size=4,
)


@settings(max_examples=60)
@given(st.sampled_from(NAMES), cuts)
@example("none", [("gap", 0.0625, 239)])  # the chunk then ends within the next chunk
@example("ours", [("gap", 0.25, 281)])  # the attachment then ends within the next chunk
def test_several_damages_together(name: str, wanted: list[tuple[str, float, int]]) -> None:
    log = named(name)
    data, touched = bytearray(log.data), list[tuple[int, int]]()
    limit = len(data)
    # from the back, so that earlier offsets stay valid
    for kind, share, maximum in sorted(wanted, key=lambda item: -item[1]):
        at = len(MAGIC) + int(share * (len(log.data) - len(MAGIC)))
        size, limit = min(maximum, limit - at), min(limit, at)
        if not size:
            continue
        match kind:
            case "flip":
                data[at] ^= 1 << size % 8
                touched.append((at, at + 1))
            case "gap":
                del data[at : at + size]
                touched.append((at, at + size))
            case "zeros":
                data[at : at + size] = bytes(len(data[at : at + size]))
                touched.append((at, at + size))
            case "insert":
                data[at:at] = random.Random(size).randbytes(size)
                touched.append((at, at + 1))
            case _:
                del data[at:]
                touched.append((at, len(log.data)))
    _, got = recovered(bytes(data))
    if not log.chunks:
        return
    kept = contents(got.elements())
    assert not kept - contents(log.messages.elements()), "a recovered message was not in the log"
    for begin, end, held in log.chunks:
        if not any(a < end and begin < b for a, b in touched):
            assert not contents(held.elements()) - kept, f"intact chunk at {begin} lost messages"


@pytest.mark.parametrize("first", NAMES)
@pytest.mark.parametrize("second", ["ours", "lz4"])
def test_both_of_two_joined_files_are_recovered(first: str, second: str) -> None:
    a, b = named(first), named(second)
    result, got = recovered(a.data + b.data)
    assert got == a.messages + b.messages, "only the channel numbers clash, not the names"
    assert (result.whole, result.files, result.losses) == (True, 2, [])


@pytest.mark.parametrize("name", ["ours", "lz4", "none", "outside chunks"])
def test_a_cut_file_with_another_one_behind_it(name: str) -> None:
    a, b = named(name), named("zstd")
    begin, end, _ = a.chunks[-2] if a.chunks else (0, len(a.data), Counter())
    result, got = recovered(a.data[: (begin + end) // 2] + b.data)
    assert not b.messages - got, "the second file lost messages"
    assert not contents(got.elements()) - contents((a.messages + b.messages).elements())
    assert (result.whole, result.files) == (False, 2)


def test_three_joined_files_of_which_one_is_damaged() -> None:
    log = named("zstd")
    begin, end, lost = log.chunks[1]
    middle = flipped(log.data, [8 * (end - 5)])
    assert begin < end
    result, got = recovered(log.data + middle + log.data)
    assert got == log.messages + log.messages + (log.messages - lost)
    assert (result.files, result.lost_messages) == (3, lost.total())


def test_bytes_behind_the_end_are_accounted_for() -> None:
    log = named("zstd")
    result, got = recovered(log.data + b"something else")
    assert got == log.messages
    assert not result.whole
    assert (
        result.losses[-1].text() == f"bytes after the file's end at byte {len(log.data)} (14 bytes)"
    )


@pytest.mark.parametrize("name", ["zstd", "lz4", "none"])
def test_a_schema_that_is_lost_has_a_stub(name: str) -> None:
    """The chunk that declares the schema is damaged, and the file ends before its summary."""
    log = named(name)
    _, end, lost = log.chunks[0]
    cut = log.data[: log.chunks[-1][1]]
    result, got = recovered(flipped(cut, [8 * (end - 5)]))
    expected = contents((log.messages - lost).elements())
    assert contents(got.elements()) == expected
    assert result.undeclared == got.total()
    assert {m.topic for m in got} == {"/undeclared/1", "/undeclared/2", "/undeclared/3"}


def test_a_channel_whose_schema_is_lost_keeps_its_name() -> None:
    """Outside chunks a schema is a separate record."""
    log = named("outside chunks")
    data = bytearray(log.data)
    place = data.find(b'{"a": 1}')
    assert data[place - 38] == 0x03
    data[place - 38 : place + 8] = bytes(46)  # from its opcode to its end
    cut = bytes(data[: data.find(b"made") - 13])
    result, got = recovered(cut)
    assert result.stub_schemas == 1
    assert {(m.topic, m.schema) for m in got} == {
        ("/first", "thing"), ("/second", ""), ("/third", "lost_schema_2"),
    }  # fmt: skip
