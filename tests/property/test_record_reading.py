"""For any file content, the reader returns messages or raises ``LogReadError``."""

from __future__ import annotations

import functools
import tempfile
from io import BytesIO
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from bridge.convert.recover import recover
from bridge.record.errors import LogReadError
from bridge.record.info import describe
from bridge.record.reader import LogReader
from support.synthetic_run import small_log

pytestmark = pytest.mark.slow


def read_all(data: bytes) -> int:
    """Read and decode everything; return the number of decoded messages."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.mcap"
        path.write_bytes(data)
        decoded = 0
        try:
            for message in LogReader(path).messages():
                try:
                    decoded += message.decoded is not None
                except ValueError:
                    continue
            describe(path)
        except LogReadError:
            return 0
        return decoded


edits = st.lists(
    st.tuples(st.floats(0, 1, exclude_max=True), st.binary(min_size=1, max_size=9)),
    min_size=1,
    max_size=4,
)


@given(edits)
def test_an_overwritten_log_never_breaks_the_reader(edits: list[tuple[float, bytes]]) -> None:
    data = bytearray(small_log())
    for where, what in edits:
        at = int(where * len(data))
        data[at : at + len(what)] = what
    read_all(bytes(data))


@given(edits)
def test_a_log_that_lost_or_won_bytes_never_breaks_the_reader(
    edits: list[tuple[float, bytes]],
) -> None:
    data = bytearray(small_log())
    for where, what in edits:
        at = int(where * len(data))
        if what[0] & 1:
            del data[at : at + len(what)]
        else:
            data[at:at] = what
    read_all(bytes(data))


@given(st.binary(max_size=300))
def test_any_bytes_behind_the_magic_never_break_the_reader(tail: bytes) -> None:
    read_all(small_log()[:8] + tail)


def test_the_log_that_these_damage_decodes_whole() -> None:
    assert read_all(small_log()) > 300


@settings(max_examples=40)
@given(edits, st.floats(0.2, 1))
def test_every_recovered_file_is_complete(edits: list[tuple[float, bytes]], share: float) -> None:
    """The mcap library checks every CRC, and the log held every recovered message."""
    data = bytearray(small_log())
    for where, what in edits:
        at = int(where * len(data))
        data[at : at + len(what)] = what
    with tempfile.TemporaryDirectory() as folder:
        broken, out = Path(folder) / "broken.mcap", Path(folder) / "out.mcap"
        broken.write_bytes(data[: max(20, int(share * len(data)))])
        try:
            result = recover(broken, out)
        except LogReadError:
            assert data[:8] != small_log()[:8]
            return
        with out.open("rb") as file:
            found = list(make_reader(file, validate_crcs=True).iter_messages())
        assert len(found) == result.messages
        assert {message.data for _, _, message in found} <= whole_log()


@functools.cache
def whole_log() -> frozenset[bytes]:
    """Return every message of the log."""
    reader = make_reader(BytesIO(small_log()))
    return frozenset(message.data for _, _, message in reader.iter_messages())
