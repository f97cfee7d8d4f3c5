"""A run's log: every record to its topics in one MCAP file."""

from __future__ import annotations

import json
import platform
from typing import TYPE_CHECKING, Any

from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

from bridge.config import parse_robot
from bridge.record import foxglove, ros, schemas
from bridge.record.chunked import ChunkedFile
from bridge.record.errors import LogWriteError
from bridge.record.room import rasterise
from bridge.telemetry import (
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
from protocol.catalogue import CATALOGUE, PROTOCOL_VERSION

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from bridge.record.layout import FlatMessage
    from bridge.telemetry import Record, RunInfo

METADATA = "sweepctl"
"""Name of the metadata record that says what was run."""
DEVICE_METADATA = "device"
"""Of each session's device, as soon as it is known: boot id, uid, firmware."""
ROBOT_ATTACHMENT, ROOM_ATTACHMENT = "robot.toml", "room.json"
CATALOGUE_ATTACHMENT, SUMMARY_ATTACHMENT = "catalogue.json", "summary.json"


class RunWriter:
    """Writes a run as it happens; what is older than a chunk survives a kill.

    Not for several threads at once. ``write`` raises :class:`LogWriteError` as soon as the
    file cannot be written, and again for every record after it.
    """

    def __init__(self, path: Path, info: RunInfo, *, force: bool = False) -> None:
        """Create the file and write what it says of itself first.

        Raises:
            LogExistsError: the file exists and ``force`` is not set.
            LogWriteError: it cannot be opened or written.
            ConfigError: ``info.robot_toml`` is no robot file.

        """
        model = parse_robot(info.robot_toml)
        self.path = path
        self._file = ChunkedFile(path, force=force, library=f"sweepctl {info.version}")
        self._foxglove = foxglove.FoxgloveEncoder()
        self._ros = ros.RosTranslator(model)
        self._ros_channels: dict[str, int] = {}
        self._device: dict[str, tuple[int, Callable[[DeviceMessage], bytes]]] = {}
        self._flat_channels: dict[str, int] = {}
        self._foxglove_channels: dict[str, int] = {}
        self._last_ns = info.opened_unix_ns
        try:
            self._write_head(info)
        except LogWriteError:
            self._file.finish()
            raise
        for name, mount in (
            ("front", model.ultrasonic),
            ("left", model.infrared_left),
            ("right", model.infrared_right),
        ):
            data = foxglove.mount(info.opened_unix_ns, name, mount)
            self._add_foxglove("/tf_static", FrameTransform, info.opened_unix_ns, data)
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
        """Record one thing on the topics that it belongs to.

        Raises:
            LogWriteError: the file cannot be written, now or since an earlier record.

        """
        if self._file.failure is not None:
            raise self._file.failure
        self._last_ns = record.log_ns
        self._handlers[type(record)](record)

    def flush(self) -> None:
        """Hand everything so far to the operating system: for when nothing more may come soon.

        Raises:
            LogWriteError: the file cannot be written.

        """
        self._file.flush()

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Attach the summary and close the file whole; again is no error.

        After a failed write it does what can still be done, without raising for it again.

        Raises:
            LogWriteError: the end could not be written; what came before it is readable.

        """
        if self._file.closed:
            return
        try:
            if summary is not None and self._file.failure is None:
                data = json.dumps(dict(summary), indent=2, default=str).encode()
                self._file.add_attachment(
                    SUMMARY_ATTACHMENT, "application/json", data, self._last_ns
                )
        finally:
            self._file.finish()

    # ---- first in the file

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

    # ---- one for each kind of record

    def _raw(self, record: RawBytes) -> None:
        topic = "/raw/uart/tx" if record.outgoing else "/raw/uart/rx"
        data = schemas.encode_raw(record)
        self._add_flat(topic, schemas.RAW_BYTES, record.log_ns, data)

    def _raw_can(self, record: RawCan) -> None:
        data = schemas.encode_raw_can(record)
        self._add_flat("/raw/can", schemas.RAW_CAN, record.log_ns, data)

    def _device_message(self, record: DeviceMessage) -> None:
        known = self._device.get(record.name)
        if known is None:
            encoder = schemas.DeviceEncoder(CATALOGUE.spec(type(record.message)))
            channel = self._flat_channel(f"/device/{record.name}", encoder.layout)
            known = self._device[record.name] = (channel, encoder.encode)
        channel, encode = known
        time_ns = record.log_ns if record.publish_ns is None else record.publish_ns
        add = self._file.add_message
        add(channel, record.log_ns, time_ns, record.seq, encode(record))
        for topic, type_name, data in self._ros.translate(record, time_ns):
            add(self._ros_channel(topic, type_name), record.log_ns, time_ns, record.seq, data)

    def _pose(self, record: PoseRecord) -> None:
        log_ns = record.log_ns
        data = self._foxglove.pose(log_ns, record.pose)
        self._add_foxglove("/pose", PoseInFrame, log_ns, data)
        estimate = schemas.encode_estimate(record)
        self._add_flat("/pose/estimate", schemas.POSE_ESTIMATE, log_ns, estimate)
        data = self._foxglove.transform(log_ns, record.pose)
        self._add_foxglove("/tf", FrameTransform, log_ns, data)

    def _truth(self, record: TruthRecord) -> None:
        data = self._foxglove.pose(record.log_ns, record.pose)
        self._add_foxglove("/truth/pose", PoseInFrame, record.log_ns, data)

    def _command(self, record: CommandRecord) -> None:
        data = schemas.encode_command(record)
        self._add_flat("/cmd", schemas.COMMAND, record.log_ns, data)

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

    # ---- channels, declared when they are first used

    def _add_flat(self, topic: str, layout: FlatMessage, log_ns: int, data: bytes) -> None:
        channel = self._flat_channels.get(topic)
        if channel is None:
            channel = self._flat_channel(topic, layout)
        self._file.add_message(channel, log_ns, log_ns, 0, data)

    def _add_foxglove(self, topic: str, message_class: type[Any], log_ns: int, data: bytes) -> None:
        channel = self._foxglove_channels.get(topic)
        if channel is None:
            schema = foxglove.schema(message_class)
            channel = self._file.add_channel(topic, "protobuf", schema)
            self._foxglove_channels[topic] = channel
        self._file.add_message(channel, log_ns, log_ns, 0, data)

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
