"""No record, message text or option text contains the key that signs commands."""

from __future__ import annotations

import pytest

from bridge.errors import KeyExposedError
from bridge.io.ports import check_local
from bridge.run.options import HostOptions
from bridge.run.recording import HostRecords
from bridge.session.records import RawBytes, RawCan
from bridge.session.states import State
from protocol.authentication import key_words
from protocol.can.frames import RECORD
from protocol.link import Received
from protocol.messages.host import SetKey, Stop
from protocol.schema.message import Direction
from protocol.uart.link import Link
from support.ends import Collector, Ends, HostEnd, spinning_host, sweeper

KEYS = [bytes(range(1, 17)), b"a pass\0phrase!\0\x0f", bytes(15) + b"\x01"]


def frames(key: bytes) -> bytes:
    """Return the bytes of a host that sends a stop, a key and another stop."""
    link = Link(Direction.HOST)
    link.send(Stop(1, 1), 0, node=1)
    link.send(SetKey(2, *key_words(key)), 0x00FF_0000, node=1)
    link.send(Stop(3, 1), 0, node=1)
    return link.data_to_send()


def recorded(pieces: list[tuple[bytes, bool]]) -> list[bytes]:
    sink = Collector()
    records = HostRecords(sink, 0, "")
    for piece, outgoing in pieces:
        records.uart(piece, 0, outgoing=outgoing)
    return [record.data for record in sink.records if isinstance(record, RawBytes)]


@pytest.mark.parametrize("key", KEYS)
def test_sent_bytes_are_recorded_without_the_key(key: bytes) -> None:
    data = frames(key)
    (kept,) = recorded([(data, True)])
    assert len(kept) == len(data)
    same = [a == b for a, b in zip(data, kept, strict=True)]
    first, last = same.index(False), len(same) - 1 - same[::-1].index(False)
    before, after = data[:first], data[last + 1 :]
    assert kept.startswith(before)
    assert kept.endswith(after)
    assert key not in kept
    assert last - first <= 22, "only payload, checksum and one COBS byte change"
    device = Link(Direction.DEVICE)
    received = [e.message for e in device.receive(kept, 0) if isinstance(e, Received)]
    assert received == [Stop(1, 1), Stop(3, 1)], (
        "the masked frame is invalid, and the others are exact"
    )


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("size", [1, 2, 3, 5, 7, 11, 1000])
def test_an_echo_is_recorded_without_the_key(key: bytes, size: int) -> None:
    data = frames(key)
    pieces = [(data[i : i + size], False) for i in range(0, len(data), size)]
    sent, *echo = recorded([(data, True), *pieces])
    assert b"".join(echo) == sent
    assert [len(piece) for piece in echo] == [len(piece) for piece, _ in pieces]


def longest_piece(secret: bytes, text: bytes) -> int:
    """Return the length of the longest part of the secret in the text, bytes."""
    runs = (secret[i:j] for i in range(len(secret)) for j in range(i + 1, len(secret) + 1))
    return max((len(run) for run in runs if run in text), default=0)


@pytest.mark.parametrize("size", [1, 5, 1000])
@pytest.mark.parametrize("damage", ["a bit at each place", "its front is lost", "noise before it"])
def test_a_damaged_echo_is_recorded_without_the_key(damage: str, size: int) -> None:
    key = KEYS[0]
    data = frames(key)
    at = data.index(key[:8])  # COBS leaves the key unchanged from here on
    damaged = {
        "a bit at each place": [
            data[:i] + bytes([data[i] ^ 0x80]) + data[i + 1 :] for i in range(at - 9, at + 16)
        ],
        "its front is lost": [data[i:] for i in range(at - 9, at + 8)],
        "noise before it": [data[: at - 9] + b"?" + data[at - 9 :]],
    }[damage]
    for echo in damaged:
        pieces = [(echo[i : i + size], False) for i in range(0, len(echo), size)]
        kept = b"".join(recorded([(data, True), *pieces])[1:])
        assert len(kept) == len(echo)
        assert longest_piece(key, kept) <= 3


def test_other_bytes_are_recorded_as_they_are() -> None:
    data = bytes(range(255, -1, -1)) * 3
    assert recorded([(frames(KEYS[0]), True), (data, True), (data, False)])[1:] == [data, data]


def test_a_bus_frame_of_a_key_is_recorded_without_it() -> None:
    sink = Collector()
    frame = RECORD.pack(0x73 << 4 | 1, 8, KEYS[0][:8])
    HostRecords(sink, 0, "", bus=True).can(frame, 0, outgoing=True)
    (record,) = sink.records
    assert isinstance(record, RawCan)
    assert (record.can_id, record.data) == (0x731, b"XXXXXXXX")


def test_no_record_of_a_session_that_sets_a_key_has_it() -> None:
    key, sink = KEYS[0], Collector()
    host = spinning_host(sink)
    ends = Ends(HostEnd(host), sweeper())
    assert ends.run(4.0, lambda: host.session.state is State.READY)
    host.session.command(SetKey, key_words(key), ends.host_ns)
    ends.run(0.5)
    sent = [r for r in sink.records if isinstance(r, RawBytes) and r.outgoing]
    assert sum(len(r.data) for r in sent) > 100
    reported = repr(sink.records).encode()
    for part in (key, key[:4], key[-4:]):
        assert not any(part in record.data for record in sent)
        assert part.hex().encode() not in reported
    for word in key_words(key):
        assert str(word).encode() not in reported


def test_no_text_has_a_key() -> None:
    words = key_words(KEYS[0])
    assert repr(SetKey(7, *words)) == "SetKey(command_id=7)"
    assert "key" not in repr(HostOptions(0, key=KEYS[0]))


@pytest.mark.parametrize("port", ["can:virtual:keys", "socket://127.0.0.1:1", "rfc2217://h:1"])
def test_a_bus_and_a_network_are_no_place_for_a_key(port: str) -> None:
    with pytest.raises(KeyExposedError, match="nothing was sent"):
        check_local(port)
    check_local("/dev/ttyUSB0")
