"""A robot as an object: what the newest data says, and commands, from ordinary code.

::

    with bridge.open("/dev/ttyUSB0") as robot:
        print(robot.imu.latest, robot.pose)
        robot.enable()
        robot.drive(0.1, 0.0)

A thread of its own runs the session; nothing moves before :meth:`Robot.enable`, and a
velocity that is not repeated within half a second is let go.
"""

from __future__ import annotations

import math
import secrets
import threading
from typing import TYPE_CHECKING, Generic, Self, TypeVar

from bridge.coverage.planner import PlannerEvent, PlannerState
from bridge.errors import (
    BridgeError,
    CommandRejectedError,
    DeviceLostError,
    DisagreementError,
    NoDeviceError,
    StoppedForSafetyError,
)
from bridge.host import Host
from bridge.host_options import HostOptions
from bridge.io import clock
from bridge.io.ports import DEFAULT_BAUD, link_of, open_port
from bridge.io.pump import Pump
from bridge.mission import Ending, Mission, Phase
from bridge.motion.geometry import Pose2
from bridge.motion.observation import HALT, Observation, VelocityCommand
from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from bridge.session_events import State
from protocol.messages import Encoders, Imu, Power, Range, Status
from protocol.values import StopCause

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from bridge.io.ports import BytePort
    from bridge.record.sink import Sink
    from protocol.message import Message

OPEN_TIMEOUT_S = 5.0
ENABLE_TIMEOUT_S = 10.0
LET_GO_S = 0.5
_POLL_S = 0.02
T = TypeVar("T", bound="Message")


class Latest(Generic[T]):
    """The newest message of one kind."""

    def __init__(self, robot: Robot, kind: type[T]) -> None:
        self._robot = robot
        self._kind = kind

    @property
    def latest(self) -> T | None:
        """The message, or None before the first of this session."""
        value = getattr(self._robot.host.state, self._kind.__name__.lower())
        return value if isinstance(value, self._kind) else None


class ManualDrive:
    """A runner that follows what it was last told, for half a second."""

    finished = False
    finish_reason = None
    turns = 0
    lane_length_m = 0.0
    state = PlannerState("manual")

    def __init__(self) -> None:
        self._told: tuple[float, VelocityCommand] | None = None
        self.target = HALT

    def drive(self, command: VelocityCommand) -> None:
        """Follow this from the next control step on."""
        self._told = (-1.0, command)

    def step(self, obs: Observation) -> VelocityCommand:
        """The velocity for this control step."""
        told = self._told
        if told is None:
            self.target = HALT
            return HALT
        since_s, command = told
        if since_s < 0.0:
            self._told = (obs.time_s, command)
        elif obs.time_s - since_s > LET_GO_S:
            self._told = None
            self.target = HALT
            return HALT
        self.target = command
        return command

    def drain_events(self) -> list[PlannerEvent]:
        """A person's decisions are not explained."""
        return []


class Robot:
    """One open robot; use it as a context manager."""

    def __init__(  # noqa: PLR0913 - what a port can be asked for
        self,
        port: str,
        *,
        model: RobotModel | None = None,
        sink: Sink | None = None,
        node: int | None = None,
        baud: int = DEFAULT_BAUD,
        timeout_s: float = OPEN_TIMEOUT_S,
    ) -> None:
        """Open the port and agree with the device.

        Raises:
            PortError: the port cannot be opened.
            NoDeviceError: no sweeper answered.
            DisagreementError: it speaks another protocol.

        """
        self.model = model or RobotModel()
        self._name, self._baud, self._timeout_s = port, baud, timeout_s
        self._sink, self._node = sink or NullSink(), node
        self._closed = False
        self.imu = Latest(self, Imu)
        self.encoders = Latest(self, Encoders)
        self.range = Latest(self, Range)
        self.power = Latest(self, Power)
        self.status = Latest(self, Status)
        self._begin(Pose2(0.0, 0.0, 0.0))

    def _begin(self, start: Pose2) -> None:
        """Open the port and agree; the robot stands at ``start``."""
        self._drive = ManualDrive()
        self._mission = Mission(None)
        self.host = Host(
            self.model,
            self._sink,
            HostOptions(clock.unix_offset_ns(), "manual", start, self._node, link_of(self._name)),
            self._mission,
            lambda: secrets.randbelow(0xFFFF_FFFE) + 1,
        )
        self._pump = Pump(self.host, self._open_port(), self._open_port)
        self._thread = threading.Thread(target=self._pump.run, name="robot", daemon=True)
        self._thread.start()
        if not self._until(lambda: self.host.session.state is State.READY, self._timeout_s):
            ending = self._mission.ending
            self._end(Ending("stopped", "no agreement", 0))
            text = ending.reason if ending else f"no agreement within {self._timeout_s:g} s"
            kind = DisagreementError if ending and ending.exit_status == 4 else NoDeviceError  # noqa: PLR2004 - the contract's status
            raise kind(f"{self._name}: {text}")

    def _open_port(self) -> BytePort:
        return open_port(self._name, baud=self._baud)

    @property
    def pose(self) -> Pose2:
        """Estimated pose, from where the robot stood as it was opened."""
        return self.host.estimator.pose

    @property
    def enabled(self) -> bool:
        """True while :meth:`drive` moves the robot."""
        return self._mission.phase is Phase.DRIVING

    def enable(self, *, clear_stop: bool = False) -> None:
        """Ask the device for leave to move; takes about 3 s at rest for the gyro.

        A stop that was latched for safety is cleared only with ``clear_stop``. Where a stop has
        ended the session, the port is opened anew.

        Raises:
            StoppedForSafetyError: such a stop is latched, or the robot is closed.
            CommandRejectedError: the device refused.
            DeviceLostError: it fell silent.
            PortError: the port cannot be opened again, or nothing answers on it.

        """
        if not self._thread.is_alive() and not self._closed:
            self._begin(self.pose)
        self._pump.call(lambda: self._mission.start(self._drive, clear_stop=clear_stop))
        self._until(lambda: self.enabled or self._mission.ending is not None, ENABLE_TIMEOUT_S)
        if not self.enabled:
            raise self._why()

    def drive(self, v_m_s: float, yaw_rate_rad_s: float) -> None:
        """Set the velocity; repeat it at least twice a second.

        What is beyond the model's limits is taken as the limit.

        Raises:
            ValueError: a velocity that is not finite.
            StoppedForSafetyError: the robot may not move (any more).
            DeviceLostError: it fell silent.

        """
        if not self.enabled:
            raise self._why()
        if not (math.isfinite(v_m_s) and math.isfinite(yaw_rate_rad_s)):
            raise ValueError(f"not a velocity: {v_m_s} m/s, {yaw_rate_rad_s} rad/s")
        command = VelocityCommand(
            _limited(v_m_s, self.model.max_speed_m_s),
            _limited(yaw_rate_rad_s, self.model.max_yaw_rate_rad_s),
        )
        # In the loop's thread, or a step between could take the older one for the newer.
        self._pump.call(lambda: self._drive.drive(command))

    def stop(self) -> None:
        """Stop and latch, cause ``operator``, and end the session: no data comes any more.

        :meth:`enable` goes on, with ``clear_stop``.
        """
        self._end(Ending("stopped", "stopped by the program", 5, StopCause.OPERATOR))

    def close(self) -> None:
        """Stop in order, and give the port back for good."""
        self._closed = True
        self._end(Ending("stopped", "closed by the program", 0))

    def _end(self, ending: Ending) -> None:
        if self._thread.is_alive():  # else its port is closed, and there is nothing to wake
            self._pump.request_end(ending)
            self._thread.join(timeout=OPEN_TIMEOUT_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _until(self, true: Callable[[], bool], timeout_s: float) -> bool:
        deadline_ns = clock.now() + round(timeout_s * 1e9)
        while not true() and self._thread.is_alive() and clock.now() < deadline_ns:
            clock.pause(_POLL_S)
        return true()

    def _why(self) -> BridgeError:
        ending = self._mission.ending
        if ending is None:
            return StoppedForSafetyError("the robot is not enabled: call enable() first")
        if ending.exit_status == 3:  # noqa: PLR2004 - the contract's status for a lost device
            return DeviceLostError(ending.reason)
        if ending.exit_status == 4:  # noqa: PLR2004 - the contract's status for a refusal
            return CommandRejectedError("to move", ending.reason)
        return StoppedForSafetyError(ending.reason)


def _limited(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
