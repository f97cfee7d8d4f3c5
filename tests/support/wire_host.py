"""A host that only sends and receives frames, without a session, an estimate or ``bridge``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic, TypeVar

from protocol.link import Received
from protocol.messages.device import Ack, Hello, LogText, Nack, Status
from protocol.messages.host import ClearStop, HostHello, PlannerCommand, SetMode, Stop, TimeRequest
from protocol.messages.values import Mode, NackReason, OnboardPlanner, PlannerAction, StopCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.link import Link

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.schema.message import Message
    from sim_device.sweeper import Sweeper

M = TypeVar("M")
D = TypeVar("D", bound="Sweeper[Any]")
SESSION = 0xBEEF
PING_US = 250_000


class WireHost(Generic[D]):
    """Bytes to and from a device, in its true time; pings keep the session open."""

    def __init__(self, device: D) -> None:
        self.device = device
        self.link = Link(Direction.HOST)
        self.now_us = 0
        self.received: list[tuple[int, int, Message]] = []
        """Received messages: true time, device's stamp, message."""
        self.newest: dict[type, Message] = {}
        self.alive = True
        self.each_step: Callable[[], None] = lambda: None
        self._id = 0
        self._ping_us = 0
        self._take(device.step(b"", 0))

    def send(self, *messages: Message) -> list[Message]:
        """Send messages now; return the device's immediate answers."""
        for message in messages:
            self.link.send(message, self.now_us, node=1)
        return self._take(self.device.step(self.link.data_to_send(), self.now_us))

    def run(self, duration_s: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass; return True once ``until`` is true."""
        end_us = self.now_us + round(duration_s * 1e6)
        while self.now_us < end_us:
            self.now_us = min(end_us, max(self.now_us + 1, self.device.next_deadline_us()))
            data = b""
            if self.alive and self.now_us >= self._ping_us:
                self._ping_us = self.now_us + PING_US
                self.link.send(TimeRequest(0), self.now_us, node=1)
                data = self.link.data_to_send()
            self._take(self.device.step(data, self.now_us))
            self.each_step()
            if until():
                return True
        return False

    def _take(self, out: bytes) -> list[Message]:
        got = [e for e in self.link.receive(out, self.now_us) if isinstance(e, Received)]
        self.received += [(self.now_us, e.frame.t_us, e.message) for e in got]
        self.newest |= {type(e.message): e.message for e in got}
        return [e.message for e in got]

    # ---- a host's requests ----------------------------------------------------------------

    def join(self, session: int = SESSION) -> None:
        self.send(HostHello(CATALOGUE.hash, session, 0, 0, "frames"))
        hello = self.newest[Hello]
        assert isinstance(hello, Hello)
        for negotiated in (0, 1):
            self.send(HostHello(CATALOGUE.hash, session, hello.boot_id, negotiated, "frames"))

    def ask(self, make: Callable[[int], Message]) -> NackReason | None:
        """Send a command, which the device must answer at once; return a rejection's reason."""
        self._id += 1
        (reply,) = [m for m in self.send(make(self._id)) if isinstance(m, Ack | Nack)]
        assert reply.command_id == self._id
        return NackReason(reply.reason) if isinstance(reply, Nack) else None

    def clear(self, cause: StopCause = StopCause.SESSION_END) -> NackReason | None:
        return self.ask(lambda i: ClearStop(i, cause))

    def choose(self, mode: int) -> NackReason | None:
        return self.ask(lambda i: SetMode(i, mode))

    def stop(self, cause: StopCause = StopCause.OPERATOR) -> NackReason | None:
        return self.ask(lambda i: Stop(i, cause))

    def plan(self, action: PlannerAction, planner: int = OnboardPlanner.PAPER) -> NackReason | None:
        return self.ask(lambda i: PlannerCommand(i, action, planner))

    def start_plan(self, planner: int = OnboardPlanner.PAPER) -> None:
        """Open a session after a boot and start a plan."""
        self.join()
        assert self.clear() is None
        self.start_plan_again(planner)

    def start_plan_again(self, planner: int = OnboardPlanner.PAPER) -> None:
        """Start a plan after a stop was cleared."""
        assert self.choose(Mode.ONBOARD) is None
        assert self.plan(PlannerAction.START, planner) is None

    # ---- received messages ----------------------------------------------------------------

    def of(self, kind: type[M]) -> list[M]:
        return [m for _, _, m in self.received if isinstance(m, kind)]

    def last(self, kind: type[M]) -> M:
        message = self.newest[kind]
        assert isinstance(message, kind)
        return message

    def lines(self) -> list[str]:
        return [m.line for m in self.of(LogText)]

    @property
    def status(self) -> Status:
        return self.last(Status)

    @property
    def hello(self) -> Hello:
        return self.last(Hello)
