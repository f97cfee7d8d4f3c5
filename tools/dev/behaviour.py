"""What both ends do with the wire, gathered from the code that does it, for PROTOCOL.md.

States are the transition tables of both ends; of the device's latch, what trying gives.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.api import pump
from bridge.run import host
from bridge.session import discovery as session_bus
from bridge.session import negotiation as session_negotiation
from bridge.session import round_trip, session
from bridge.session import states as session_events
from protocol import commands
from protocol.can import link as can_link
from protocol.can import stamps as can_stamps
from protocol.can import transfers as can_segments
from protocol.generate.md import Behaviour, Machine, Rule
from protocol.messages.values import StopCause
from sim_device import sweeper as device
from sim_device.device import commands as device_commands
from sim_device.device import (
    health,
    log_lines,
    modes,
    onboard,
    parameters,
    safety,
    streams,
    virtual_firmware,
)

if TYPE_CHECKING:
    from collections.abc import Iterator


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
        "`bridge.session.states.TRANSITIONS`. A lost device is looked for again; what answers then "
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
        "`sim_device.device.safety.StopLatch`. The gravest cause holds, and only `clear_stop` with "
        "its name releases it. What is not drawn changes nothing.",
        _name(safety.StopLatch().cause),
        moves,
    )


def _name(cause: StopCause) -> str:
    return "free" if cause is StopCause.NONE else cause.name.lower()


def _modes() -> Machine:
    return Machine(
        "The device's modes",
        "`sim_device.device.modes.TABLE`, from which the emulated firmware takes every step. "
        "`onboard`, `running` and `paused` are one mode on the wire; `stopped` and what stands "
        "before it are idle. A stopping fault is a robot lifted, a wheel without counts, a motor "
        f"that has stood for {health.STALL_STOP_S:g} s under current, an empty battery, and while "
        "the device plans for itself a gyro that cannot be believed. What is not drawn changes "
        "nothing or is refused.",
        modes.State.OFF.value,
        modes.drawn(),
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
        _us(virtual_firmware.TICK_US),
        "sim_device.device.virtual_firmware.TICK_US",
    )
    yield Rule(
        "device",
        "hello, until agreed, every",
        _us(virtual_firmware.HELLO_TICKS * virtual_firmware.TICK_US),
        "sim_device.device.virtual_firmware.HELLO_TICKS",
    )
    yield Rule(
        "device",
        "most that a setpoint may live",
        _us(safety.MAX_TIME_TO_LIVE_US),
        "sim_device.device.safety.MAX_TIME_TO_LIVE_US",
    )
    yield Rule(
        "device",
        "no valid host frame: session over, stop latched with cause `link`",
        _us(safety.HOST_SILENCE_US),
        "sim_device.device.safety.HOST_SILENCE_US",
    )
    yield Rule(
        "device",
        "most drift between the two clocks that freshness allows for",
        f"{safety.DRIFT_ALLOWANCE_PPM} ppm",
        "sim_device.device.safety.DRIFT_ALLOWANCE_PPM",
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
        _us(log_lines.LOG_PERIOD_US),
        "sim_device.device.log_lines.LOG_PERIOD_US",
    )
    yield Rule(
        "device",
        "slowest rate that `sync` may be set to",
        f"{device_commands.SYNC_RATE_MIN / 10:g} Hz",
        "sim_device.device.commands.SYNC_RATE_MIN",
    )
    yield Rule(
        "device",
        "most duty in bring-up",
        f"{safety.BRINGUP_DUTY_MAX:g}",
        "sim_device.device.safety.BRINGUP_DUTY_MAX",
    )
    for what, us, source in (
        ("from reset to its first control period", device.BOOT_US, "sweeper.BOOT_US"),
        ("a program that hangs is reset after", device.WATCHDOG_US, "sweeper.WATCHDOG_US"),
        ("onboard: at rest before the first leg", onboard.AT_REST_US, "device.onboard.AT_REST_US"),
    ):
        yield Rule("device", what, _us(us), f"sim_device.{source}")
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
        ("from opening to agreement at most", session.AGREE_TIMEOUT_NS, "AGREE_TIMEOUT_NS"),
        ("no device frame: lost after", session.LOST_AFTER_NS, "LOST_AFTER_NS"),
        (f"first {session.FAST_PINGS} time requests, every", session.FAST_PING_NS, "FAST_PING_NS"),
        (
            "then time requests, which keep the session alive, every",
            session.SLOW_PING_NS,
            "SLOW_PING_NS",
        ),
    ):
        yield Rule("host", what, _ms(value), f"bridge.session.session.{source}")
    yield Rule(
        "host",
        f"least round trip of the last {round_trip.PINGS} time requests, the device's turnaround "
        "taken off, that allows motion; no motion before there are as many, and in a run a stop "
        "with cause `link`",
        _ms(round_trip.LIMIT_NS),
        "bridge.session.round_trip.LIMIT_NS",
    )
    yield Rule(
        "host",
        "the same stop where no time request is answered within that limit for",
        _ms(round_trip.UNANSWERED_NS),
        "bridge.session.round_trip.UNANSWERED_NS",
    )
    yield Rule(
        "host",
        "turnaround of the device that is taken off a round trip, at most",
        _ms(round_trip.TURNAROUND_NS),
        "bridge.session.round_trip.TURNAROUND_NS",
    )
    yield Rule(
        "host",
        "a time request comes early, each by another share of",
        _ms(session.PING_SPREAD_NS),
        "bridge.session.session.PING_SPREAD_NS",
    )
    yield Rule(
        "host",
        f"handshakes with a device that begins anew: {session.HANDSHAKES_AT_ONCE} at "
        "once, then one every",
        _ms(session.HANDSHAKE_PERIOD_NS),
        "bridge.session.session.HANDSHAKE_PERIOD_NS",
    )
    yield Rule(
        "host",
        "questions asked again after",
        _ms(session.ANSWER_PERIOD_NS),
        "bridge.session.session.ANSWER_PERIOD_NS",
    )
    yield Rule(
        "host",
        "questions under way at the same time",
        str(session_negotiation.QUESTIONS_AT_ONCE),
        "bridge.session.negotiation.QUESTIONS_AT_ONCE",
    )
    yield Rule(
        "host", "setpoint, every", _ms(host.CONTROL_PERIOD_NS), "bridge.run.host.CONTROL_PERIOD_NS"
    )
    yield Rule(
        "host",
        "time to live that it gives a setpoint",
        f"{host.SETPOINT_TTL_MS} ms",
        "bridge.run.host.SETPOINT_TTL_MS",
    )
    yield Rule("host", "sends nothing older than", _ms(host.LATE_NS), "bridge.run.host.LATE_NS")
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
        ("oldest short stamp that can be extended", can_stamps.OLDEST_US, "can.stamps.OLDEST_US"),
        ("a transfer is given up after", can_segments.OPEN_US, "can.transfers.OPEN_US"),
        ("an equal frame is the same one again within", can_link.DOUBLE_US, "can.link.DOUBLE_US"),
    ):
        yield Rule("both, on CAN", what, _us(value), f"protocol.{source}")
    yield Rule(
        "host, on CAN",
        "from the first hello heard, time for other devices to answer",
        _ms(session_bus.ANSWERS_NS),
        "bridge.session.discovery.ANSWERS_NS",
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
