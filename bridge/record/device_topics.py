"""A device message's topics: our own, and those of its ROS counterparts, written together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bridge.record.bundle import Bundle
from bridge.record.schemas import DeviceEncoder

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.record.chunked import ChunkedFile
    from bridge.record.ros import RosForm, RosTopic
    from bridge.telemetry import DeviceMessage
    from protocol.message import MessageSpec

_NANOSECONDS = 1_000_000_000


class DeviceTopics:
    """Writes the messages of one type.

    Which fields are absent (a sentinel's SI value, what an older device does not know, the
    bound while there is no clock mapping) decides the form, and there are few of them: each
    is packed in one go, with every message's header.
    """

    def __init__(
        self,
        file: ChunkedFile,
        spec: MessageSpec,
        ros: RosForm | None,
        ros_channel: Callable[[RosTopic], int],
    ) -> None:
        """Declare the device's own channel; those of ROS follow with the first message."""
        self._file = file
        self._encoder = DeviceEncoder(spec)
        layout = self._layout = self._encoder.layout
        schema = (layout.full_name, "protobuf", layout.descriptor_set())
        self._channel = file.add_channel(f"/device/{spec.name}", "protobuf", schema)
        self._ros, self._ros_channel = ros, ros_channel
        self._bundles: dict[tuple[bool, ...] | None, Bundle] = {}

    def write(self, record: DeviceMessage) -> None:
        """Write one message to all its topics.

        Raises:
            LogWriteError: the file cannot be written.

        """
        log_ns, publish_ns, _, _, seq, _, _, message = record
        time_ns = log_ns if publish_ns is None else publish_ns
        fields = self._encoder.values(record)
        if not self._layout.is_fixed:  # rare messages with a text in them
            data = self._layout.encode(fields)
            self._file.add_message(self._channel, log_ns, time_ns, seq, data)
            return
        whole = None not in fields
        shown = None if whole else tuple([value is not None for value in fields])
        ros = self._ros
        if ros is not None and not whole and None in tuple(message)[: ros.needs]:
            ros = None
        bundle = self._bundles.get(shown)
        if bundle is None:
            bundle = self._bundles[shown] = self._bundle(fields, ros)
        values: list[Any] = [seq, log_ns, time_ns]
        values += fields if whole else [value for value in fields if value is not None]
        if ros is not None:
            head = (seq, log_ns, time_ns, time_ns // _NANOSECONDS, time_ns % _NANOSECONDS)
            for of_topic in ros.values(record):
                values += head
                values += of_topic
        bundle.add(log_ns, values)

    def _bundle(self, fields: list[Any], ros: RosForm | None) -> Bundle:
        present = [i for i, value in enumerate(fields) if value is not None]
        messages = [(self._channel, self._layout.parts(present))]
        if ros is not None:
            messages += [(self._ros_channel(t), t.layout.parts) for t in ros.topics]
        return Bundle(self._file, messages)
