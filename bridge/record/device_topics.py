"""A device message's topics: our own, and those of its ROS counterparts, written together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from bridge.record.chunk import CHUNK_BYTES
from bridge.record.encode.rows import Head, RowMessage, real, ros_stamp, scaled
from bridge.record.encode.schemas import DeviceEncoder

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.record.chunked_file import ChunkedFile
    from bridge.record.encode.ros import RosMessages, RosTopic
    from bridge.record.encode.rows import Rows
    from bridge.session.records import DeviceMessage
    from protocol.schema.message import MessageSpec

_LOG, _PUBLISH, _BOUND, _NODE, _SEQUENCE, _T_US, _RAW = range(1, 8)
"""Columns of a row after its place; the message's own fields are the last."""


class _Form(NamedTuple):
    """Messages of which the same values are there."""

    rows: Rows
    ros_values: Callable[[DeviceMessage], tuple[float, ...]] | None


class DeviceTopics:
    """Writes the messages of one type.

    Which fields are absent (a sentinel's SI value, what an older device does not know, the
    bound while there is no clock mapping) decides the form, and there are few of them: each
    is a kind of row of its own.
    """

    def __init__(
        self,
        file: ChunkedFile,
        spec: MessageSpec,
        ros: RosMessages | None,
        ros_channel: Callable[[RosTopic], int],
    ) -> None:
        """Declare the device's own channel; those of ROS follow with the first message."""
        self._file, self._chunk = file, file.chunk
        self._encoder = DeviceEncoder(spec)
        layout = self._layout = self._encoder.layout
        schema = (layout.full_name, "protobuf", layout.descriptor_set())
        self._channel = file.add_channel(f"/device/{spec.name}", "protobuf", schema)
        self._ros, self._ros_channel = ros, ros_channel
        self._raw = len(spec.fields)
        self._fixed = layout.is_fixed
        self._sentinels = any(field.none is not None for field in spec.fields)
        self._whole: _Form | None = None
        self._forms: dict[tuple[bool, ...], _Form] = {}

    def write(self, record: DeviceMessage) -> None:
        """Write one message to all its topics.

        Raises:
            LogWriteError: the file cannot be written.

        """
        log_ns = record[0]
        raw: tuple[Any, ...] = record[7]  # type: ignore[assignment]  # what it is at run time
        if not self._fixed:  # rare messages with a text in them
            time_ns = log_ns if record.publish_ns is None else record.publish_ns
            data = self._layout.encode(self._encoder.values(record))
            self._file.add_message(self._channel, log_ns, time_ns, record.seq, data)
            return
        values: tuple[Any, ...] = record[:6] + raw  # the columns are a record's own order
        if None in values or self._sentinels:
            form = self._some(record, values)
            values = tuple([value or 0 for value in values])
        else:
            form = self._whole or self._form(None)
        rows, ros_values = form
        chunk = self._chunk
        # As begin_row does it, without the call: two of five records come here.
        if not chunk.earliest_ns <= log_ns < chunk.deadline_ns or chunk.size >= CHUNK_BYTES:
            self._file.next_chunk(log_ns)
        rows.ints.append(chunk.size)
        rows.ints.extend(values)
        chunk.size += rows.size
        if ros_values is not None:
            rows.floats.extend(ros_values(record))

    def _some(self, record: DeviceMessage, values: tuple[Any, ...]) -> _Form:
        """The form of a message of which something may be absent."""
        shown = (
            values[_PUBLISH - 1] is not None,
            *(value is not None for value in self._encoder.values(record)),
        )
        return self._forms.get(shown) or self._form(shown)

    def _form(self, shown: tuple[bool, ...] | None) -> _Form:
        """Make the form of messages with these values, publish time first; None: with all."""
        encoder, layout, ros = self._encoder, self._layout, self._ros
        present = [i for i in range(len(layout.fields)) if shown is None or shown[1 + i]]
        published = shown is None or shown[0]
        head = Head(_LOG, _PUBLISH if published else _LOG, _SEQUENCE)
        sources = encoder.sources((_T_US, _NODE, _BOUND), _RAW)
        messages = [
            RowMessage(self._channel, head, layout.parts(present), [sources[i] for i in present])
        ]
        # The fields of a message come third in a layout, as on the wire.
        if ros is not None and shown is not None and not all(shown[4 : 4 + ros.needs]):
            ros = None
        floats = 0
        if ros is not None:
            stamp = ros_stamp(head.publish)
            for topic in ros.topics:
                count = sum(isinstance(part, str) for part in topic.layout.parts) - len(stamp)
                if ros.values is None:
                    own = [scaled(_RAW + i, gain) for i, gain in ros.raw]
                else:
                    own = [real(floats + i) for i in range(count)]
                    floats += count
                channel = self._ros_channel(topic)
                messages.append(RowMessage(channel, head, topic.layout.parts, [*stamp, *own]))
        rows = self._file.rows(_RAW + self._raw, floats, messages)
        form = _Form(rows, None if ros is None else ros.values)
        if shown is None:
            self._whole = form
        else:
            self._forms[shown] = form
        return form
