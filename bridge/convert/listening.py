"""Records of a capture, equal to the records of a live run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.motion.estimation.estimator import PoseEstimator
from bridge.motion.geometry import Pose2
from bridge.run.recording import HostRecords
from bridge.session.event_kinds import EventKind
from bridge.session.ingest import Ingest
from bridge.session.records import Severity
from bridge.session.timesync import TimeSync
from protocol.can.frames import RECORD
from protocol.can.link import CanLink
from protocol.clock import HostNs
from protocol.imu import NOMINAL, ImuReader
from protocol.link import Received, Rejected
from protocol.messages.device import Encoders, Hello, Imu, LogText
from protocol.schema.message import Direction
from protocol.uart.framing import DamagedFrame

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel
    from bridge.record.sink import Sink
    from protocol.link import LinkBase


class Listener:
    """Records received bytes and the decoded messages. It sends nothing."""

    def __init__(self, sink: Sink, model: RobotModel, link: LinkBase) -> None:
        """Decode with ``link``, the host's link; times are Unix time."""
        self.messages = 0
        """Number of device messages."""
        self._link = link
        self._last_frame_ns = HostNs(0)
        self._sink, self._records = sink, HostRecords(sink, 0, "")
        self._ingest = Ingest(TimeSync(), 0)
        self._estimator = PoseEstimator(model, Pose2(0.0, 0.0, 0.0))
        self._imu = ImuReader(NOMINAL)
        self._sends = {s.type_id for s in link.codec.catalogue if s.direction is Direction.HOST}

    def received(self, data: bytes, now_ns: HostNs) -> None:
        """Record received bytes; on a bus, frames of both sides."""
        if isinstance(self._link, CanLink):
            for begin in range(0, len(data), RECORD.size):
                frame = data[begin : begin + RECORD.size]
                can_id, _, _ = RECORD.unpack(frame)
                self._records.can(frame, now_ns, outgoing=can_id >> 4 in self._sends)
        else:
            self._records.uart(data, now_ns, outgoing=False)
        self._last_frame_ns = now_ns
        self._records.flush(now_ns)
        damaged: list[DamagedFrame] = []
        for event in self._link.receive(data, now_ns // 1000):
            match event:
                case Received():
                    self._message(event, now_ns)
                case DamagedFrame():
                    damaged.append(event)
                case Rejected() if event.reason != "direction":
                    self._records.rejected(event, now_ns)

        if damaged:
            self._records.damaged(damaged, now_ns)

    def close(self) -> None:
        """Record the collected damaged frames."""
        self._records.flush(self._last_frame_ns, at_once=True)

    def _message(self, received: Received, now_ns: HostNs) -> None:
        self.messages += 1
        self._sink.write(self._ingest.take(received, now_ns))
        device_us = self._ingest.device_us
        match message := self._imu.take(received.message):
            case Imu():
                self._estimator.on_imu(
                    device_us * 1e-6,
                    *(message.gyro_z_rad_s, message.accel_x_m_s2, message.accel_y_m_s2),
                    message.temperature_deg_c,
                )
            case Encoders():
                self._estimator.on_encoders(device_us * 1e-6, message.left, message.right)
                if self._estimator.known:
                    self._records.pose(self._estimator.pose, self._estimator, now_ns)
            case LogText():
                self._records.log_text(message, now_ns)
            case Hello() if message.catalogue_hash != self._link.codec.catalogue.hash:
                text = "the device has another catalogue; fields may be missing or wrong"
                self._records.event(now_ns, Severity.WARNING, "session", EventKind.SCHEMA, text)
