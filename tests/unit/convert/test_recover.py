"""Recovery of damaged logs: the mcap library's reader checks the recovered file."""

from __future__ import annotations

import io
import json
import struct
from typing import TYPE_CHECKING

import pytest
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, DataEnd, Footer, Header, MessageIndex
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer

from bridge.convert.recover import recover
from bridge.errors import OutputExistsError
from bridge.record.errors import LogReadError, LogWriteError
from bridge.record.file_summary import FileSummary
from bridge.record.reader import LogReader
from support.cli import sweepctl
from support.hostile_logs import GOOD, MAGIC, claims_to_be_empty, file_of, record
from support.synthetic_run import first_records, write_synthetic_log

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

pytestmark = pytest.mark.slow

Message = tuple[str, int, bytes]
CHUNK = 0x06
_LENGTH = struct.Struct("<Q")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return six seconds of a run."""
    path = tmp_path_factory.mktemp("recover") / "run.mcap"
    return write_synthetic_log(path, first_records(6.0))


def read_all(path: Path) -> list[Message]:
    """Return all messages by the library's reader, which checks every CRC and needs the summary."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = [
            (channel.topic, message.log_time, message.data)
            for _, channel, message in reader.iter_messages()
        ]
        reported = reader.get_summary()
        assert reported is not None
        assert reported.statistics is not None
        assert reported.statistics.message_count == len(found)
        return found


def chunks(data: bytes | bytearray) -> list[tuple[int, int]]:
    """Return the file offset and total length of every chunk of an intact file."""
    found, position = [], 8
    while position < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, position)
        if opcode == CHUNK:
            found.append((position, 9 + length))
        position += 9 + length
    return found


def messages_in(data: bytes, offset: int, length: int) -> list[Message]:
    """Return the messages in one chunk of an intact file, as the library reads them."""
    reported = make_reader(io.BytesIO(data)).get_summary()
    assert reported is not None
    one = io.BytesIO(data[:8] + data[offset : offset + length])
    chunk = next(StreamReader(one, emit_chunks=True).records)
    assert isinstance(chunk, Chunk)
    return [
        (reported.channels[record.channel_id].topic, record.log_time, record.data)
        for record in breakup_chunk(chunk)
        if isinstance(record, Record)
    ]


def without(everything: list[Message], lost: list[Message]) -> list[Message]:
    left = everything.copy()
    for message in lost:
        left.remove(message)
    return left


def test_a_complete_file_is_not_changed(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    result = recover(log, out)
    assert (result.losses, result.whole, result.undeclared) == ([], True, 0)
    assert read_all(out) == read_all(log)
    before, after = LogReader(log), LogReader(out)
    assert after.attachments == before.attachments
    assert after.metadata == before.metadata
    assert not after.truncated


@pytest.mark.parametrize("place", [0.1, 0.5, 0.9])
def test_a_chunk_damaged_in_its_content_is_left_out_and_reported(
    log: Path, tmp_path: Path, place: float
) -> None:
    data = bytearray(log.read_bytes())
    found = chunks(data)
    offset, length = found[round(place * (len(found) - 1))]
    lost = messages_in(bytes(data), offset, length)
    data[offset + length - 40] ^= 0x10
    broken, out = tmp_path / "broken.mcap", tmp_path / "out.mcap"
    broken.write_bytes(data)
    result = recover(broken, out)
    assert read_all(out) == without(read_all(log), lost)
    (loss,) = result.losses
    assert (loss.offset, loss.bytes) == (offset, length)
    assert sum(loss.messages.values()) == len(lost) > 20
    assert loss.messages["/pose"] == sum(topic == "/pose" for topic, _, _ in lost)
    assert loss.start_ns == min(time for _, time, _ in lost)
    assert loss.end_ns == max(time for _, time, _ in lost)
    assert LogReader(broken).problems == []
    reader = LogReader(broken)
    assert [(m.topic, m.log_ns, m.data) for m in reader.messages()] == read_all(out)
    assert len(reader.problems) == 1


@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(lambda d, o: d.__setitem__(o, 0x00), id="no opcode"),
        pytest.param(lambda d, o: d.__setitem__(o + 3, 0xFF), id="a length beyond the file"),
        pytest.param(
            lambda d, o: _LENGTH.pack_into(d, o + 1, _LENGTH.unpack_from(d, o + 1)[0] - 0x55),
            id="a length too short",
        ),
        pytest.param(
            lambda d, o: d.__setitem__(slice(o, o + 64), bytes(64)), id="the head overwritten"
        ),
    ],
)
def test_a_damaged_head_of_a_chunk_costs_that_chunk_only(
    log: Path, tmp_path: Path, damage: Callable[[bytearray, int], None]
) -> None:
    data = bytearray(log.read_bytes())
    found = chunks(data)
    offset, length = found[len(found) // 2]
    lost = messages_in(bytes(data), offset, length)
    damage(data, offset)
    broken, out = tmp_path / "broken.mcap", tmp_path / "out.mcap"
    broken.write_bytes(data)
    result = recover(broken, out)
    # The content's own sizes and CRC locate it and prove it intact, unless they are gone.
    is_gone = not any(data[offset : offset + 64])
    assert read_all(out) == without(read_all(log), lost if is_gone else [])
    assert result.lost_messages == (len(lost) if is_gone else 0), "the indexes say what it held"
    reader = LogReader(broken)
    left = without(read_all(log), lost)
    assert [(m.topic, m.log_ns, m.data) for m in reader.messages()] == left
    assert "skipped" in reader.problems[0]
    assert not reader.truncated


def test_channels_that_a_lost_chunk_declared_are_in_the_summary(log: Path, tmp_path: Path) -> None:
    data = bytearray(log.read_bytes())
    offset, length = chunks(data)[0]
    lost = messages_in(bytes(data), offset, length)
    data[offset + length // 2] ^= 1
    broken, out = tmp_path / "broken.mcap", tmp_path / "out.mcap"
    broken.write_bytes(data)
    result = recover(broken, out)
    assert result.undeclared == 0
    assert read_all(out) == without(read_all(log), lost)
    assert next(iter(LogReader(out).messages(["/pose"]))).decoded.frame_id == "map"
    assert next(iter(LogReader(broken).messages(["/pose"]))).decoded.frame_id == "map"


def test_without_a_summary_such_messages_keep_their_bytes(log: Path, tmp_path: Path) -> None:
    data = bytearray(log.read_bytes())
    found = chunks(data)
    offset, length = found[0]
    data[offset + length // 2] ^= 1
    end = sum(found[-1])
    broken, out = tmp_path / "broken.mcap", tmp_path / "out.mcap"
    broken.write_bytes(data[:end])
    result = recover(broken, out)
    kept = read_all(out)
    lost = messages_in(log.read_bytes(), offset, length)
    whole = without(read_all(log), lost)
    assert [message[1:] for message in kept] == [message[1:] for message in whole]
    assert result.undeclared == sum(topic.startswith("/undeclared/") for topic, _, _ in kept) > 100


def test_a_truncated_file_keeps_its_complete_part(log: Path, tmp_path: Path) -> None:
    data = log.read_bytes()
    offset, length = chunks(data)[-3]
    broken, out = tmp_path / "broken.mcap", tmp_path / "out.mcap"
    broken.write_bytes(data[: offset + length // 2])
    result = recover(broken, out)
    everything = read_all(log)
    kept = read_all(out)
    assert kept == everything[: len(kept)]
    assert not result.whole
    assert LogReader(broken).truncated
    assert "truncated" in result.losses[-1].what


def foreign(path: Path, *, compression: CompressionType, chunked: bool = True) -> list[Message]:
    """Write a file of another program: JSON, a channel without a schema, big chunks."""
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, use_chunking=chunked, chunk_size=400_000)
        writer.start(profile="other", library="somebody else")
        schema = writer.register_schema("thing", "jsonschema", b"{}")
        first = writer.register_channel("/json", "json", schema)
        second = writer.register_channel("/bytes", "application/octet-stream", 0)
        for i in range(4000):
            writer.add_message(first, i, json.dumps({"i": i, "x": i / 3}).encode(), i, i)
            writer.add_message(second, i + 1, bytes([i % 251]) * 190, i, i)
        writer.add_attachment(5, 5, "notes", "text/plain", b"hello")
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    return read_all(path)


@pytest.mark.parametrize("compression", list(CompressionType))
def test_files_of_other_programs(tmp_path: Path, compression: CompressionType) -> None:
    path, out = tmp_path / "foreign.mcap", tmp_path / "out.mcap"
    everything = foreign(path, compression=compression)
    data = bytearray(path.read_bytes())
    offset, length = chunks(data)[1]
    lost = messages_in(bytes(data), offset, length)
    data[offset + 60] ^= 0xFF
    path.write_bytes(data)
    result = recover(path, out)
    assert read_all(out) == without(everything, lost)
    assert result.lost_messages == len(lost)
    with out.open("rb") as file:
        reader = make_reader(file)
        header = reader.get_header()
        assert (header.profile, header.library) == ("other", "somebody else")
        assert [a.data for a in reader.iter_attachments()] == [b"hello"]


def test_messages_outside_chunks(tmp_path: Path) -> None:
    path, out = tmp_path / "foreign.mcap", tmp_path / "out.mcap"
    everything = foreign(path, compression=CompressionType.NONE, chunked=False)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    recover(path, out)
    kept = read_all(out)
    assert kept == everything[: len(kept)]
    assert len(kept) > 0.45 * len(everything)


def test_a_truncated_chunk_keeps_its_unpackable_part(tmp_path: Path) -> None:
    path, out = tmp_path / "foreign.mcap", tmp_path / "out.mcap"
    everything = foreign(path, compression=CompressionType.ZSTD)
    data = path.read_bytes()
    offset, length = chunks(data)[1]
    path.write_bytes(data[: offset + length * 9 // 10])
    result = recover(path, out)
    kept = read_all(out)
    assert kept == everything[: len(kept)]
    assert result.rescued > 100, "whole zstd blocks of the cut chunk"


def test_the_index_of_the_copy_leads_to_every_message(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    recover(log, out)
    with out.open("rb") as file:
        indexed = sum(
            len(record.records)
            for record in StreamReader(file, emit_chunks=True).records
            if isinstance(record, MessageIndex)
        )
        file.seek(0)
        ordered = list(make_reader(file).iter_messages(["/pose"]))
    assert indexed == len(read_all(log))
    assert len(ordered) == sum(topic == "/pose" for topic, _, _ in read_all(log))


def test_a_chunk_that_claims_to_be_empty_is_not_copied(tmp_path: Path) -> None:
    """The library's reader rejects a frame whose size is given nowhere."""
    path, out = tmp_path / "foreign.mcap", tmp_path / "out.mcap"
    path.write_bytes(file_of([claims_to_be_empty()]))
    result = recover(path, out)
    assert [data for _, _, data in read_all(out)] == [GOOD]
    assert [loss.what for loss in result.losses] == ["a damaged chunk"]


def test_what_cannot_be(log: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(log.read_bytes())
    with pytest.raises(LogWriteError, match="it is the source file"):
        recover(copy, copy, force=True)
    assert copy.read_bytes() == log.read_bytes()
    with pytest.raises(OutputExistsError):
        recover(log, copy)
    with pytest.raises(LogReadError):
        recover(tmp_path / "none.mcap", tmp_path / "out.mcap")
    (tmp_path / "text").write_text("hello")
    with pytest.raises(LogReadError, match="not an MCAP file"):
        recover(tmp_path / "text", tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


def test_the_command(log: Path, tmp_path: Path) -> None:
    data = bytearray(log.read_bytes())
    offset, length = chunks(data)[4]
    data[offset + length - 9] ^= 0x80
    broken, out = tmp_path / "broken.mcap", tmp_path / "out.mcap"
    broken.write_bytes(data)
    done = sweepctl("recover", broken, "--out", out, "--json")
    assert done.status == 0
    assert done.json["lost_messages"] == sum(done.json["losses"][0]["messages"].values()) > 20
    assert f"lost: a damaged chunk at byte {offset}" in done.err
    assert done.json["messages"] == len(read_all(out))
    again = sweepctl("recover", broken, "--out", out)
    assert again.status == 1
    assert "--force" in again.line
    assert sweepctl("recover", broken, "--out", out, "--force").status == 0
    assert sweepctl("recover", broken).status == 2


def test_a_full_disk_is_reported_with_the_file_that_is_written(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "full.mcap"
    out.symlink_to("/dev/full")
    done = sweepctl("recover", log, "--out", out, "--force")
    assert done.status == 1
    assert f"cannot write {out}: No space left on device" in done.line


def test_the_last_summary_is_not_read_for_each_file_that_was_joined(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its records are as long as the files before it, so it looks like the summary of each."""
    joined, declared = 50, 200
    short = MAGIC + record(Header(profile="", library=""))
    ids = range(1, declared + 1)
    channels = [record(Channel(number, "", "", {}, schema_id=0)) for number in ids]
    assert {len(channel) for channel in channels} == {len(short)}
    data = short + record(DataEnd(0))
    summary_start = joined * len(short) + len(data)  # from the first of the short files
    data += b"".join(channels) + record(Footer(summary_start, 0, 0)) + MAGIC
    (tmp_path / "joined.mcap").write_bytes(joined * short + data)
    read: list[int] = []
    take = FileSummary.take

    def counted(self: FileSummary, opcode: int, content: bytes, begin: int) -> None:
        read.append(opcode)
        take(self, opcode, content, begin)

    monkeypatch.setattr(FileSummary, "take", counted)
    recovery = recover(tmp_path / "joined.mcap", tmp_path / "recovered.mcap")
    assert recovery.files == joined + 1
    assert declared <= len(read) <= 2 * declared
