"""Topics of a device message: its own topic, and the topics of equivalent ROS messages."""

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
"""Columns of a row after its offset. The message's own fields start at ``_RAW``."""


class _Age(NamedTuple):
    """A field that contains the age of a sample when the message was stamped."""

    place: int
    """Index of the field in the record."""
    step_ns: int
    """Resolution of the field, ns."""
    none: int | None
    """Raw value that means that no age is known."""


class _Form(NamedTuple):
    """Rows for messages in which the same values are present."""

    rows: Rows
    ros_values: Callable[[DeviceMessage], tuple[float, ...]] | None
    ages: tuple[_Age, ...]
    """Ages for ROS topics. Each age adds a column with the sampling time after the record's
    columns."""


class DeviceTopics:
    """Writes the messages of one type.

    A value may be absent: a sentinel, a field that an older device does not have, or the clock's
    error bound without a clock mapping. The form of a message is the set of its present values.
    There are few forms, and each form has its own rows.
    """

    def __init__(
        self,
        file: ChunkedFile,
        spec: MessageSpec,
        ros: RosMessages | None,
        ros_channel: Callable[[RosTopic], int],
        *,
        has_si: bool = True,
    ) -> None:
        """Declare the device's own channel. ROS channels are declared at the first message.

        Without ``has_si`` the scale of the raw values is not known yet; see :meth:`rescale`.
        """
        self._file, self._chunk = file, file.chunk
        self._spec = spec
        self._encoder = DeviceEncoder(spec, has_si=has_si)
        layout = self._layout = self._encoder.layout
        schema = (layout.full_name, "protobuf", layout.descriptor_set())
        self._channel = file.add_channel(f"/device/{spec.name}", "protobuf", schema)
        self._ros, self._ros_channel = ros, ros_channel
        self._raw = len(spec.fields)
        self._fixed = layout.is_fixed
        self._sentinels = any(field.none is not None for field in spec.fields)
        self._whole: _Form | None = None
        self._forms: dict[tuple[bool, ...], _Form] = {}

    def rescale(self, spec: MessageSpec) -> None:
        """Use the scales in ``spec`` from now on."""
        self._spec, self._encoder = spec, DeviceEncoder(spec)
        self._whole, self._forms = None, {}

    def write(self, record: DeviceMessage) -> None:
        """Write one message to all its topics.

        Raises:
            LogWriteError: the file cannot be written.

        """
        log_ns = record[0]
        raw: tuple[Any, ...] = record[7]  # type: ignore[assignment]  # messages are tuples
        if not self._fixed:  # rare: messages with text
            time_ns = log_ns if record.publish_ns is None else record.publish_ns
            data = self._layout.encode(self._encoder.values(record))
            self._file.add_message(self._channel, log_ns, time_ns, record.seq, data)
            return
        values: tuple[Any, ...] = record[:6] + raw  # columns in the record's order
        if None in values or self._sentinels or not self._encoder.has_si:
            form = self._some(record, values)
            values = tuple([value or 0 for value in values])
        else:
            form = self._whole or self._form(None)
        rows, ros_values, ages = form
        chunk = self._chunk
        # begin_row is inlined here, because 40 % of all records pass here.
        if not chunk.earliest_ns <= log_ns < chunk.deadline_ns or chunk.size >= CHUNK_BYTES:
            self._file.next_chunk(log_ns)
        rows.ints.append(chunk.size)
        rows.ints.extend(values)
        chunk.size += rows.size
        if ros_values is not None:
            rows.floats.extend(ros_values(record))
            for place, step_ns, none in ages:
                age = values[place]
                time_ns = values[_PUBLISH - 1] or log_ns
                rows.ints.append(time_ns if age == none else time_ns - step_ns * age)

    def _some(self, record: DeviceMessage, values: tuple[Any, ...]) -> _Form:
        """Return the form of a message that may have absent values."""
        shown = (
            values[_PUBLISH - 1] is not None,
            *(value is not None for value in self._encoder.values(record)),
        )
        return self._forms.get(shown) or self._form(shown)

    def _form(self, shown: tuple[bool, ...] | None) -> _Form:
        """Create the form with these values, publish time first, present; None: all present."""
        encoder, layout, ros = self._encoder, self._layout, self._ros
        present = [i for i in range(len(layout.fields)) if shown is None or shown[1 + i]]
        published = shown is None or shown[0]
        head = Head(_LOG, _PUBLISH if published else _LOG, _SEQUENCE)
        sources = encoder.sources((_T_US, _NODE, _BOUND), _RAW)
        messages = [
            RowMessage(self._channel, head, layout.parts(present), [sources[i] for i in present])
        ]
        # In the layout and in the wire format, the message's own fields start at the third
        # position.
        if shown is not None and ros is not None and not all(shown[4 : 4 + ros.needs]):
            ros = None
        if not encoder.has_si:
            ros = None
        floats = 0
        ages: list[_Age] = []
        if ros is not None:
            for topic in ros.topics:
                sampled = head
                if topic.age is not None:
                    field = self._spec.fields[topic.age]
                    sampled = head._replace(publish=_RAW + self._raw + len(ages))
                    step_ns = round(1e9 * field.si_gain)
                    ages.append(_Age(_RAW - 1 + topic.age, step_ns, field.none))
                stamp = ros_stamp(sampled.publish)
                count = sum(isinstance(part, str) for part in topic.layout.parts) - len(stamp)
                if ros.values is None:
                    own = [scaled(_RAW + i, self._spec.fields[i].si_gain) for i in ros.raw]
                else:
                    own = [real(floats + i) for i in range(count)]
                    floats += count
                channel = self._ros_channel(topic)
                messages.append(RowMessage(channel, sampled, topic.layout.parts, [*stamp, *own]))
        rows = self._file.rows(_RAW + self._raw + len(ages), floats, messages)
        form = _Form(rows, None if ros is None else ros.values, tuple(ages))
        if shown is None:
            self._whole = form
        else:
            self._forms[shown] = form
        return form
