"""A log of another program whose messages use the topic names of sweepctl."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from bridge.doctor.log_examination import _Log
from bridge.record.reader import LogMessage
from protocol.can.frames import RECORD

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bridge.doctor.examination import Examination


class Reader:
    """A log reader that returns these messages."""

    truncated = False

    def __init__(self, *messages: tuple[str, Any]) -> None:
        self.problems: list[str] = []
        self.run: dict[str, str] = {}
        self._messages = [
            LogMessage(channel(topic, decoded), 1_000 * i, 0, 0, b"")  # type: ignore[arg-type]  # as much of a channel as is read
            for i, (topic, decoded) in enumerate(messages)
        ]

    def messages(self, topics: set[str] | None = None) -> Iterator[LogMessage]:
        return (m for m in self._messages if topics is None or m.topic in topics)


def channel(topic: str, decoded: Any) -> SimpleNamespace:  # noqa: ANN401 - any decoded message
    return SimpleNamespace(topic=topic, schema_name="x", decode=lambda _data: decoded)


def examined(*messages: tuple[str, Any]) -> Examination:
    return _Log(Reader(*messages)).examine()  # type: ignore[arg-type]  # as much of a reader as is used


def frame(**values: object) -> SimpleNamespace:
    return SimpleNamespace(**{"can_id": 0x121, "data": b"abc", "outgoing": False, **values})


def test_invalid_bus_frames_are_left_out() -> None:
    odd = [
        frame(can_id="engine"),
        frame(can_id=-1),
        frame(data=7),
        frame(data=["a"]),
        SimpleNamespace(id=3),
    ]
    seen = examined(("/raw/can", frame()), *(("/raw/can", message) for message in odd))
    assert seen.wire.bytes_in == RECORD.size
    assert (
        examined(("/raw/can", frame(data=[1, 2, 3], outgoing=True))).wire.bytes_out == RECORD.size
    )


def test_invalid_bytes_are_left_out() -> None:
    odd = [SimpleNamespace(data="text"), SimpleNamespace(data=None), SimpleNamespace(), None]
    line = [("/raw/uart/rx", message) for message in (SimpleNamespace(data=b"\x00\x01"), *odd)]
    assert examined(*line).wire.bytes_in == 2


def test_messages_of_other_types_are_left_out() -> None:
    good = {"left": 1, "right": 2, "t_us": 5}
    for bad in ({"left": None}, {"t_us": "noon"}):
        wire = examined(("/device/encoders", SimpleNamespace(**{**good, **bad}))).wire
        assert not wire.streams
    assert "encoders" in examined(("/device/encoders", SimpleNamespace(**good))).wire.streams


def test_events_of_another_shape_are_left_out() -> None:
    ours = {"source": "link", "kind": "port_lost", "text": "it is gone", "severity": "error"}
    seen = examined(("/events", SimpleNamespace(what="x")), ("/events", SimpleNamespace(**ours)))
    assert seen.port_lost == ["it is gone"]
