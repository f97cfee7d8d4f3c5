"""Writer of a run's log: converts records to messages in one MCAP file."""

from __future__ import annotations

import json
import platform
from typing import TYPE_CHECKING, Any

from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

from bridge.record.chunked_file import ChunkedFile
from bridge.record.device_topics import DeviceTopics
from bridge.record.encode import foxglove, ros, schemas
from bridge.record.encode.occupancy_grid import rasterise
from bridge.record.encode.rows import Head, RowMessage, half_angle, proto_stamp, real
from bridge.record.errors import LogWriteError
from bridge.record.names import (
    CATALOGUE_ATTACHMENT,
    DEVICE_METADATA,
    METADATA,
    ROBOT_ATTACHMENT,
    ROOM_ATTACHMENT,
    SUMMARY_ATTACHMENT,
)
from bridge.record.storage import open_log_file
from bridge.session.records import (
    ClockRecord,
    CommandRecord,
    CoverageRecord,
    DeviceMessage,
    EventRecord,
    IdentityRecord,
    LogRecord,
    PlannerRecord,
    PoseRecord,
    RawBytes,
    RawCan,
    RoomRecord,
    TruthRecord,
)
from protocol.imu import ImuScale
from protocol.messages.device import Imu, ImuInfo
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from bridge.record.chunked_file import ChunkTap, LogOpener
    from bridge.record.encode.foxglove import MessageType
    from bridge.record.encode.layout import FlatMessage
    from bridge.record.encode.ros import RosTopic
    from bridge.record.encode.rows import Rows
    from bridge.session.records import Record, RunInfo
    from protocol.schema.message import Message

_LOGGED = Head(1, 1)
"""Header of a host message: log time and publish time are the integer after the row's offset."""
_PLANAR = (proto_stamp(1), real(0), real(1), *half_angle(2))
"""Sources of a pose: x, y and yaw are the first floats of a row."""


class RunWriter:
    """Writes a run while it happens. If the process is killed, all but the last chunk is readable.

    Not thread-safe. After a failed write, :meth:`write` raises :class:`LogWriteError` for every
    record.
    """

    def __init__(
        self,
        path: Path,
        info: RunInfo,
        *,
        force: bool = False,
        opener: LogOpener = open_log_file,
        tap: ChunkTap | None = None,
    ) -> None:
        """Create the file and write its attachments and metadata.

        ``tap`` receives a copy of its chunks.

        Raises:
            OutputExistsError: the file exists, and ``force`` is False.
            LogWriteError: the file cannot be opened or written.

        """
        model = info.robot
        self.path = path
        library = f"sweepctl {info.version}"
        self._file = ChunkedFile(path, force=force, library=library, opener=opener, tap=tap)
        self._ros = ros.RosTranslator(model)
        self._ros_channels: dict[str, int] = {}
        self._device: dict[str, DeviceTopics] = {}
        self._imu_scale: ImuScale | None = None
        self._imu_info: DeviceTopics | None = None
        self._rows: dict[type, Rows] = {}
        self._flat_channels: dict[str, int] = {}
        self._foxglove_channels: dict[str, int] = {}
        begun_ns = info.opened_unix_ns if info.begun_unix_ns is None else info.begun_unix_ns
        self._last_ns = begun_ns
        try:
            self._write_head(info)
        except LogWriteError:
            self._file.finish()
            if not force and path.is_file():  # a new file without content
                path.unlink(missing_ok=True)
            raise
        for name, mount in (
            ("front", model.ultrasonic),
            ("left", model.infrared_left),
            ("right", model.infrared_right),
        ):
            data = foxglove.mount(begun_ns, name, mount)
            self._add_foxglove("/tf_static", FrameTransform, begun_ns, data)
        self._handlers: dict[type, Callable[[Any], None]] = {
            RawBytes: self._raw,
            RawCan: self._raw_can,
            DeviceMessage: self._device_message,
            PoseRecord: self._pose,
            TruthRecord: self._truth,
            CommandRecord: self._command,
            PlannerRecord: self._planner,
            EventRecord: self._event,
            LogRecord: self._log,
            ClockRecord: self._clock,
            CoverageRecord: self._coverage,
            RoomRecord: self._room,
            IdentityRecord: self._identity,
        }

    def write(self, record: Record) -> None:
        """Write one record to its topics.

        Raises:
            LogWriteError: this write or an earlier write failed.

        """
        if self._file.out.failure is not None:
            raise self._file.out.failure
        self._last_ns = record[0]
        if record.__class__ is DeviceMessage:  # the most frequent and slowest records
            topics = self._device.get(record[6])
            if topics is not None:
                topics.write(record)
                return
        self._handlers[record.__class__](record)

    @property
    def bytes_written(self) -> int:
        """Length of the file so far, bytes."""
        return self._file.out.offset

    def flush(self) -> None:
        """Write the open chunk, for example before a pause without records.

        Raises:
            LogWriteError: the file cannot be written.

        """
        self._file.flush()

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Attach the summary and complete the file. It may be called again.

        After a failed write it completes what is still possible and does not raise another error.

        Raises:
            LogWriteError: the end could not be written. The content before the end is readable.

        """
        if self._file.closed:
            return
        try:
            if summary is not None and self._file.out.failure is None:
                data = json.dumps(dict(summary), indent=2, default=str).encode()
                self._file.add_attachment(
                    SUMMARY_ATTACHMENT, "application/json", data, self._last_ns
                )
        finally:
            self._file.finish()

    # ---- start of the file

    def _write_head(self, info: RunInfo) -> None:
        def attach(name: str, media_type: str, text: str) -> None:
            self._file.add_attachment(name, media_type, text.encode(), info.opened_unix_ns)

        attach(ROBOT_ATTACHMENT, "application/toml", info.robot_toml)
        if info.plan is not None:
            attach(ROOM_ATTACHMENT, "application/json", info.plan.to_json())
        attach(CATALOGUE_ATTACHMENT, "application/json", schemas.catalogue_json())
        own = {
            "version": info.version,
            "python": platform.python_version(),
            "protocol_version": str(PROTOCOL_VERSION),
            "catalogue_hash": f"{CATALOGUE.hash:08x}",
            "port": info.port,
            "planner": info.planner,
            "opened_unix_ns": str(info.opened_unix_ns),
            "clock_offset_ns": str(info.clock_offset_ns),
        }
        if info.seed is not None:
            own["seed"] = str(info.seed)
        self._file.add_metadata(METADATA, {**info.extra, **own})

    # ---- handlers of record types

    def _raw(self, record: RawBytes) -> None:
        log_ns, outgoing, data = record
        topic = "/raw/uart/tx" if outgoing else "/raw/uart/rx"
        channel = self._flat_channels.get(topic)
        if channel is None:
            channel = self._flat_channel(topic, schemas.RAW_BYTES)
        self._file.add_message(channel, log_ns, log_ns, 0, schemas.encode_raw(data))

    def _raw_can(self, record: RawCan) -> None:
        data = schemas.encode_raw_can(record)
        self._add_flat("/raw/can", schemas.RAW_CAN, record.log_ns, data)

    def _device_message(self, record: DeviceMessage) -> None:
        """Handle the first message of a type. Later messages go directly to the type's topics.

        Messages with the scale of the IMU are an exception: all of them pass here.
        """
        cls = type(record.message)
        if cls is ImuInfo:
            self._note_imu(record.message)  # type: ignore[arg-type]  # its class was compared
            self._imu_info = self._imu_info or self._topics(ImuInfo)
            self._imu_info.write(record)
            return
        topics = self._device[record.name] = self._topics(cls)
        topics.write(record)

    def _topics(self, cls: type[Message]) -> DeviceTopics:
        spec, scale = CATALOGUE.spec(cls), self._imu_scale
        known = cls is not Imu or scale is not None
        if scale is not None:
            spec = scale.declared(spec)
        ros = self._ros.form(cls)
        return DeviceTopics(self._file, spec, ros, self._ros_topic, has_si=known)

    def _note_imu(self, info: ImuInfo) -> None:
        """Compute the SI values of IMU samples with the scale that the device reports."""
        scale = ImuScale.of(info)
        if scale is None or scale == self._imu_scale:
            return
        self._imu_scale = scale
        topics = self._device.get("imu")
        if topics is not None:
            topics.rescale(scale.declared(CATALOGUE.spec(Imu)))

    def _pose(self, record: PoseRecord) -> None:
        rows = self._rows.get(PoseRecord)
        if rows is None:
            pose = self._foxglove_channel("/pose", PoseInFrame)
            estimate = self._flat_channel("/pose/estimate", schemas.POSE_ESTIMATE)
            transform = self._foxglove_channel("/tf", FrameTransform)
            values = [real(column) for column in range(len(schemas.POSE_ESTIMATE.fields))]
            rows = self._rows[PoseRecord] = self._file.rows(
                2,
                len(values),
                (
                    RowMessage(pose, _LOGGED, foxglove.POSE_PARTS, _PLANAR),
                    RowMessage(estimate, _LOGGED, schemas.POSE_ESTIMATE.all_parts, values),
                    RowMessage(transform, _LOGGED, foxglove.TRANSFORM_PARTS, _PLANAR),
                ),
            )
        log_ns = record[0]
        place = self._file.begin_row(log_ns, rows.size)  # may empty the rows
        rows.ints.extend((place, log_ns))
        rows.floats.extend(schemas.estimate_values(record))

    def _truth(self, record: TruthRecord) -> None:
        rows = self._rows.get(TruthRecord)
        if rows is None:
            channel = self._foxglove_channel("/truth/pose", PoseInFrame)
            message = RowMessage(channel, _LOGGED, foxglove.POSE_PARTS, _PLANAR)
            rows = self._rows[TruthRecord] = self._file.rows(2, 3, (message,))
        log_ns, pose = record
        place = self._file.begin_row(log_ns, rows.size)  # may empty the rows
        rows.ints.extend((place, log_ns))
        rows.floats.extend(pose)

    def _command(self, record: CommandRecord) -> None:
        rows = self._rows.get(CommandRecord)
        if rows is None:
            channel = self._flat_channel("/cmd", schemas.COMMAND)
            values = [real(column) for column in range(len(schemas.COMMAND.fields))]
            message = RowMessage(channel, _LOGGED, schemas.COMMAND.all_parts, values)
            rows = self._rows[CommandRecord] = self._file.rows(2, len(values), (message,))
        log_ns = record[0]
        place = self._file.begin_row(log_ns, rows.size)  # may empty the rows
        rows.ints.extend((place, log_ns))
        rows.floats.extend(record[1:])

    def _planner(self, record: PlannerRecord) -> None:
        data = schemas.encode_planner(record)
        self._add_flat("/planner", schemas.PLANNER_STATE, record.log_ns, data)

    def _event(self, record: EventRecord) -> None:
        self._add_flat("/events", schemas.EVENT, record.log_ns, schemas.encode_event(record))

    def _log(self, record: LogRecord) -> None:
        self._add_foxglove("/log", Log, record.log_ns, foxglove.log(record))

    def _clock(self, record: ClockRecord) -> None:
        data = schemas.encode_clock(record)
        self._add_flat("/clock/sync", schemas.CLOCK_SYNC, record.log_ns, data)

    def _coverage(self, record: CoverageRecord) -> None:
        self._add_grid("/map/coverage", record)

    def _room(self, record: RoomRecord) -> None:
        self._add_grid("/map/room", rasterise(record.plan, record.log_ns))

    def _identity(self, record: IdentityRecord) -> None:
        device = {
            "node": str(record.node),
            "uid": record.uid.hex(),
            "boot_id": f"{record.boot_id:08x}",
            "session_id": f"{record.session_id:08x}",
            "reset_cause": record.reset_cause,
            "firmware": record.firmware,
            "catalogue_hash": f"{record.catalogue_hash:08x}",
            "log_ns": str(record.log_ns),
        }
        self._file.add_metadata(DEVICE_METADATA, device)

    # ---- channels, declared on first use

    def _add_flat(self, topic: str, layout: FlatMessage, log_ns: int, data: bytes) -> None:
        channel = self._flat_channels.get(topic)
        if channel is None:
            channel = self._flat_channel(topic, layout)
        self._file.add_message(channel, log_ns, log_ns, 0, data)

    def _add_foxglove(self, topic: str, message: MessageType, log_ns: int, data: bytes) -> None:
        channel = self._foxglove_channel(topic, message)
        self._file.add_message(channel, log_ns, log_ns, 0, data)

    def _foxglove_channel(self, topic: str, message: MessageType) -> int:
        channel = self._foxglove_channels.get(topic)
        if channel is None:
            channel = self._file.add_channel(topic, "protobuf", foxglove.schema(message))
            self._foxglove_channels[topic] = channel
        return channel

    def _ros_topic(self, topic: RosTopic) -> int:
        return self._ros_channel(topic.name, topic.type_name)

    def _add_grid(self, topic: str, record: CoverageRecord) -> None:
        channel = self._ros_channel(topic, ros.OCCUPANCY_GRID)
        data = ros.occupancy_grid(record)
        self._file.add_message(channel, record.log_ns, record.log_ns, 0, data)

    def _flat_channel(self, topic: str, layout: FlatMessage) -> int:
        schema = (layout.full_name, "protobuf", layout.descriptor_set())
        channel = self._flat_channels[topic] = self._file.add_channel(topic, "protobuf", schema)
        return channel

    def _ros_channel(self, topic: str, type_name: str) -> int:
        channel = self._ros_channels.get(topic)
        if channel is None:
            schema = (type_name, "ros2msg", ros.schema_text(type_name).encode())
            channel = self._ros_channels[topic] = self._file.add_channel(topic, "cdr", schema)
        return channel
