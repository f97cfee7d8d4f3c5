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
from bridge.host import Host, HostOptions
from bridge.io import clock
from bridge.io.ports import DEFAULT_BAUD, link_of, open_port
from bridge.io.pump import Pump
from bridge.mission import Ending, Mission, Phase
from bridge.motion.observation import HALT, Observation, VelocityCommand
from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from bridge.session import State
from protocol.messages import Encoders, Imu, Power, Range, Status
from protocol.values import StopCause

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from bridge.io.ports import BytePort
    from bridge.motion.geometry import Pose2
    from bridge.record.sink import Sink
    from protocol.message import Message

OPEN_TIMEOUT_S = 5.0
ENABLE_TIMEOUT_S = 10.0
LET_GO_S = 0.5
_POLL_S = 0.02
T = TypeVar("T", bound="Message")


class Latest(Generic[T]):
    """The newest message of one kind."""

    def __init__(self, host: Host, kind: type[T]) -> None:
        self._host = host
        self._kind = kind

    @property
    def latest(self) -> T | None:
        """The message, or None before the first of this session."""
        value = getattr(self._host.state, self._kind.__name__.lower())
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
            return HALT
        since_s, command = told
        if since_s < 0.0:
            self._told = (obs.time_s, command)
        elif obs.time_s - since_s > LET_GO_S:
            self._told = None
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

        def reopen() -> BytePort:
            return open_port(port, baud=baud)

        self._drive = ManualDrive()
        self._mission = Mission(None)
        self._host = Host(
            model or RobotModel(),
            sink or NullSink(),
            HostOptions(clock.unix_offset_ns(), "manual", node=node, link=link_of(port)),
            self._mission,
            lambda: secrets.randbelow(0xFFFF_FFFE) + 1,
        )
        self._pump = Pump(self._host, reopen(), reopen)
        self._thread = threading.Thread(target=self._pump.run, name="robot", daemon=True)
        self.imu = Latest(self._host, Imu)
        self.encoders = Latest(self._host, Encoders)
        self.range = Latest(self._host, Range)
        self.power = Latest(self._host, Power)
        self.status = Latest(self._host, Status)
        self._thread.start()
        if not self._until(lambda: self._host.session.state is State.READY, timeout_s):
            ending = self._mission.ending
            self.close()
            text = ending.reason if ending else f"no agreement within {timeout_s:g} s"
            kind = DisagreementError if ending and ending.exit_status == 4 else NoDeviceError  # noqa: PLR2004 - the contract's status
            raise kind(f"{port}: {text}")

    @property
    def pose(self) -> Pose2:
        """Estimated pose, from where the robot stood as it was opened."""
        return self._host.estimator.pose

    @property
    def enabled(self) -> bool:
        """True while :meth:`drive` moves the robot."""
        return self._mission.phase is Phase.DRIVING

    def enable(self, *, clear_stop: bool = False) -> None:
        """Ask the device for leave to move; takes about 3 s at rest for the gyro.

        A stop that was latched for safety is cleared only with ``clear_stop``.

        Raises:
            StoppedForSafetyError: such a stop is latched.
            CommandRejectedError: the device refused.
            DeviceLostError: it fell silent.

        """
        self._pump.call(lambda: self._mission.start(self._drive, clear_stop=clear_stop))
        self._until(lambda: self.enabled or self._mission.ending is not None, ENABLE_TIMEOUT_S)
        if not self.enabled:
            raise self._why()

    def drive(self, v_m_s: float, yaw_rate_rad_s: float) -> None:
        """Set the velocity; repeat it at least twice a second.

        Raises:
            StoppedForSafetyError: the robot may not move (any more).
            DeviceLostError: it fell silent.

        """
        if not self.enabled:
            raise self._why()
        self._drive.drive(VelocityCommand(v_m_s, yaw_rate_rad_s))

    def stop(self) -> None:
        """Stop and latch, cause ``operator``; :meth:`enable` then needs ``clear_stop``."""
        self._pump.request_end(Ending("stopped", "stopped by the program", 5, StopCause.OPERATOR))
        self._thread.join(timeout=OPEN_TIMEOUT_S)

    def close(self) -> None:
        """Stop in order, and give the port back."""
        self._pump.request_end(Ending("stopped", "closed by the program", 0))
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
