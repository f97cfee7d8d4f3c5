"""What both ends do with the wire, gathered from the code that does it, for PROTOCOL.md.

The host's states are its transition table. The device's are found by trying: an emulated
device is brought into each state, and everything that may happen there is made to happen.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge import host, session, session_events
from bridge.coverage.floorplan import FloorPlan
from bridge.io import pump
from bridge.motion.geometry import Pose2
from protocol import can_link, can_segments, can_stamps, commands
from protocol.catalogue import CATALOGUE
from protocol.generate.md import Behaviour, Machine, Rule
from protocol.link import Link
from protocol.message import Direction
from protocol.messages import ClearStop, HostHello, SetMode, Stop, TimeRequest
from protocol.values import Mode, StopCause
from sim_device import commands as device_commands
from sim_device import firmware, parameters, safety, streams
from sim_device.device import VirtualSweeper

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from protocol.message import Message

_SQUARE = FloorPlan("", ((0, 0), (2, 0), (2, 2), (0, 2)), (), Pose2(1.0, 1.0, 0.0))


def wire_behaviour() -> Behaviour:
    """States, timing rules and the numbers of a motor command's life."""
    return Behaviour(
        machines=[_session(), _latch(), _modes()], rules=list(_rules()), numbers=_numbers()
    )


# ---- states -------------------------------------------------------------------------------


def _session() -> Machine:
    moves = [
        (old.value, what, new.value)
        for (old, what), new in session_events.TRANSITIONS.items()
        if old is not new
    ]
    return Machine(
        "The host's session",
        "`bridge.session_events.TRANSITIONS`. A lost device is looked for again; what answers then "
        "must be the same device, and agrees anew.",
        session_events.State.CLOSED.value,
        moves,
    )


def _latch() -> Machine:
    causes = [c for c in StopCause if c is not StopCause.NONE]
    moves: list[tuple[str, str, str]] = []
    for held in StopCause:
        for cause in causes:
            latch = safety.StopLatch(held)
            if latch.latch(cause):
                moves.append((_name(held), f"stop {_name(cause)}", _name(latch.cause)))
            latch = safety.StopLatch(held)
            if latch.clear(cause):
                moves.append((_name(held), f"clear {_name(cause)}", _name(latch.cause)))
    return Machine(
        "The device's latch",
        "`sim_device.safety.StopLatch`. The gravest cause holds, and only `clear_stop` with its "
        "name releases it. What is not drawn changes nothing.",
        _name(safety.StopLatch().cause),
        moves,
    )


def _name(cause: StopCause) -> str:
    return "free" if cause is StopCause.NONE else cause.name.lower()


class _Trial:
    """An emulated device and a host's hand-made frames."""

    def __init__(self) -> None:
        self.device = VirtualSweeper(_SQUARE, noise="none")
        self._link = Link(Direction.HOST)
        self._now_us = 0
        self._id = 0
        self.send(HostHello(CATALOGUE.hash, 1, 1, ""))

    def send(self, *messages: Message) -> None:
        for message in messages:
            self._link.send(message, self._now_us, node=1)
        self.device.step(self._link.data_to_send(), self._now_us)

    def stop(self) -> None:
        self._id += 1
        self.send(Stop(self._id, StopCause.OPERATOR))

    def clear(self) -> None:
        self._id += 1
        self.send(ClearStop(self._id, self.device.firmware.latch.cause))

    def choose(self, mode: Mode) -> None:
        self._id += 1
        self.send(SetMode(self._id, mode))

    def fall_silent(self) -> None:
        self._now_us += safety.HOST_SILENCE_US + 2 * firmware.TICK_US
        self.device.step(b"", self._now_us)
        self.send(TimeRequest(0))

    def take_over(self) -> None:
        self.send(HostHello(CATALOGUE.hash, 2, 1, ""))

    @property
    def state(self) -> str:
        if self.device.firmware.latch.latched:
            return "latched"
        return self.device.firmware.mode.name.lower()


_ACTIONS: dict[str, Callable[[_Trial], None]] = {
    "clear_stop": _Trial.clear,
    **{
        f"set_mode {mode.name.lower()}": (lambda trial, mode=mode: trial.choose(mode))  # type: ignore[misc]
        for mode in Mode
    },
    "stop": _Trial.stop,
    "host silent": _Trial.fall_silent,
    "hello of another session": _Trial.take_over,
}


def _modes() -> Machine:
    moves: list[tuple[str, str, str]] = []
    for start in ("latched", *(m.name.lower() for m in Mode)):
        for name, act in _ACTIONS.items():
            trial = _Trial()
            if start != "latched":
                trial.clear()
                trial.choose(Mode[start.upper()])
            if trial.state != start:
                break  # the device has no such mode
            act(trial)
            if trial.state != start:
                moves.append((start, name, trial.state))
    return Machine(
        "The device's modes",
        "Found by trying each of these in each state of the emulated device. `clear_stop` names "
        "the cause that holds. What is not drawn changes nothing or is refused.",
        _Trial().state,
        moves,
    )


# ---- timing -------------------------------------------------------------------------------


def _ms(ns: float) -> str:
    return f"{ns / 1e6:g} ms"


def _us(us: float) -> str:
    return _ms(us * 1000)


def _rules() -> Iterator[Rule]:
    yield Rule(
        "device",
        "control period; no stream is quicker",
        _us(firmware.TICK_US),
        "sim_device.firmware.TICK_US",
    )
    yield Rule(
        "device",
        "hello, until agreed, every",
        _us(firmware.HELLO_TICKS * firmware.TICK_US),
        "sim_device.firmware.HELLO_TICKS",
    )
    yield Rule(
        "device",
        "most that a setpoint may live",
        _us(safety.MAX_TIME_TO_LIVE_US),
        "sim_device.safety.MAX_TIME_TO_LIVE_US",
    )
    yield Rule(
        "device",
        "no valid host frame: session over, stop latched with cause `link`",
        _us(safety.HOST_SILENCE_US),
        "sim_device.safety.HOST_SILENCE_US",
    )
    yield Rule(
        "device",
        "most drift between the two clocks that freshness allows for",
        f"{safety.DRIFT_ALLOWANCE_PPM} ppm",
        "sim_device.safety.DRIFT_ALLOWANCE_PPM",
    )
    yield Rule(
        "device",
        "replies kept for repeated commands",
        str(commands.REMEMBERED),
        "protocol.commands.REMEMBERED",
    )
    yield Rule(
        "device",
        "between two log texts",
        _us(firmware.LOG_PERIOD_US),
        "sim_device.firmware.LOG_PERIOD_US",
    )
    yield Rule(
        "device",
        "slowest rate that `sync` may be set to",
        f"{device_commands.SYNC_RATE_MIN / 10:g} Hz",
        "sim_device.commands.SYNC_RATE_MIN",
    )
    yield Rule(
        "device",
        "most duty in bring-up",
        f"{safety.BRINGUP_DUTY_MAX:g}",
        "sim_device.safety.BRINGUP_DUTY_MAX",
    )
    yield from _host_rules()
    yield from _can_rules()


def _host_rules() -> Iterator[Rule]:
    for what, value, source in (
        ("hello while nobody has answered, every", session.HELLO_PERIOD_NS, "HELLO_PERIOD_NS"),
        (
            "gives up on a port where nobody answers after",
            session.OPEN_TIMEOUT_NS,
            "OPEN_TIMEOUT_NS",
        ),
        ("questions asked again after", session.ANSWER_PERIOD_NS, "ANSWER_PERIOD_NS"),
        ("from opening to agreement at most", session.AGREE_TIMEOUT_NS, "AGREE_TIMEOUT_NS"),
        ("no device frame: lost after", session.LOST_AFTER_NS, "LOST_AFTER_NS"),
        (f"first {session.FAST_PINGS} time requests, every", session.FAST_PING_NS, "FAST_PING_NS"),
        (
            "then time requests, which keep the session alive, every",
            session.SLOW_PING_NS,
            "SLOW_PING_NS",
        ),
    ):
        yield Rule("host", what, _ms(value), f"bridge.session.{source}")
    yield Rule(
        "host",
        "questions under way at the same time",
        str(session.QUESTIONS_AT_ONCE),
        "bridge.session.QUESTIONS_AT_ONCE",
    )
    yield Rule(
        "host", "setpoint, every", _ms(host.CONTROL_PERIOD_NS), "bridge.host.CONTROL_PERIOD_NS"
    )
    yield Rule(
        "host",
        "time to live that it gives a setpoint",
        f"{host.SETPOINT_TTL_MS} ms",
        "bridge.host.SETPOINT_TTL_MS",
    )
    yield Rule("host", "sends nothing older than", _ms(host.LATE_NS), "bridge.host.LATE_NS")
    for what, value, source in (
        ("first reply to a command awaited for", commands.FIRST_TIMEOUT_US, "FIRST_TIMEOUT_US"),
        (
            "then by the measured round trip (RFC 6298), at least",
            commands.MIN_TIMEOUT_US,
            "MIN_TIMEOUT_US",
        ),
        ("doubling with each try, at most", commands.MAX_TIMEOUT_US, "MAX_TIMEOUT_US"),
    ):
        yield Rule("host", what, _us(value), f"protocol.commands.{source}")
    yield Rule(
        "host",
        "tries of a command; a stop is repeated until answered",
        str(commands.MAX_TRIES),
        "protocol.commands.MAX_TRIES",
    )


def _can_rules() -> Iterator[Rule]:
    for what, value, source in (
        ("oldest short stamp that can be extended", can_stamps.OLDEST_US, "can_stamps.OLDEST_US"),
        ("a transfer is given up after", can_segments.OPEN_US, "can_segments.OPEN_US"),
        ("an equal frame is the same one again within", can_link.DOUBLE_US, "can_link.DOUBLE_US"),
    ):
        yield Rule("both, on CAN", what, _us(value), f"protocol.{source}")
    yield Rule(
        "host, on CAN",
        "from the first hello heard, time for other devices to answer",
        _ms(session.SETTLE_NS),
        "bridge.session.SETTLE_NS",
    )


def _numbers() -> dict[str, str]:
    return {
        "control_ms": f"{host.CONTROL_PERIOD_NS / 1e6:g}",
        "ttl_ms": str(host.SETPOINT_TTL_MS),
        "late_ms": f"{host.LATE_NS / 1e6:g}",
        "stuck_ms": f"{pump.STUCK_NS / 1e6:g}",
        "max_ttl_ms": f"{safety.MAX_TIME_TO_LIVE_US / 1000:g}",
        "tick_ms": f"{1000 / streams.TICK_HZ:g}",
        "decel": f"{parameters.STOP_DECELERATION_M_S2:g}",
        "silence_s": f"{safety.HOST_SILENCE_US / 1e6:g}",
    }
