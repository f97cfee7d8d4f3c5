"""Behaviour of both ends of the protocol, collected from their code, for PROTOCOL.md.

The states come from the transition tables of host and device. The transitions of the device's latch
are found by calling it with every cause.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.api import pump
from bridge.motion.robot_model import RobotModel
from bridge.run import host
from bridge.session import discovery as session_bus
from bridge.session import negotiation as session_negotiation
from bridge.session import round_trip, session
from bridge.session import states as session_events
from protocol import retransmission
from protocol.can import link as can_link
from protocol.can import stamps as can_stamps
from protocol.can import transfers as can_segments
from protocol.generate.md import Behaviour, Machine, ParameterRow, TimingRule
from protocol.messages.values import StopCause
from sim_device import sweeper as device
from sim_device.device import commands as device_commands
from sim_device.device import (
    freshness,
    health,
    log_lines,
    modes,
    onboard,
    parameters,
    streams,
    virtual_firmware,
    watchdog,
)
from sim_device.device.latch import StopLatch

if TYPE_CHECKING:
    from collections.abc import Iterator


def wire_behaviour() -> Behaviour:
    """Return states, timing rules and the numbers of the section about one setpoint."""
    return Behaviour(
        machines=[_session(), _latch(), _modes()],
        parameters=list(_parameters()),
        rules=list(_rules()),
        numbers=_numbers(),
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
        "Source: `bridge.session.states.TRANSITIONS`. After a loss the host searches for its "
        "device. The same device must answer, and the handshake is repeated.",
        session_events.State.CLOSED.value,
        moves,
    )


def _latch() -> Machine:
    causes = [c for c in StopCause if c is not StopCause.NONE]
    moves: list[tuple[str, str, str]] = []
    for held in StopCause:
        for cause in causes:
            latch = StopLatch(held)
            if latch.latch(cause):
                moves.append((_name(held), f"stop {_name(cause)}", _name(latch.cause)))
            latch = StopLatch(held)
            if latch.clear(cause):
                moves.append((_name(held), f"clear {_name(cause)}", _name(latch.cause)))
    return Machine(
        "The device's latch",
        "Source: `sim_device.device.latch.StopLatch`. The most severe cause stays latched. Only "
        "`clear_stop` with that cause releases it. Events that are not shown change nothing.",
        _name(StopLatch().cause),
        moves,
    )


def _name(cause: StopCause) -> str:
    return "free" if cause is StopCause.NONE else cause.name.lower()


def _modes() -> Machine:
    return Machine(
        "The device's modes",
        "Source: `sim_device.device.modes.TABLE`, which the emulated firmware executes. The "
        "protocol reports `onboard`, `running` and `paused` as mode `onboard`, and `off`, `boot` "
        "and `stopped` as mode `idle`. Stopping faults: the robot is lifted, a wheel gives no "
        f"counts, a motor stalls for {health.STALL_STOP_S:g} s, or the battery is empty. While "
        "the device's own planner runs, an implausible gyro is a stopping fault as well. Events "
        "that are not shown change nothing or are rejected.",
        modes.DeviceState.OFF.value,
        modes.drawn(),
    )


# ---- parameters ---------------------------------------------------------------------------


def _parameters() -> Iterator[ParameterRow]:
    for number, row in enumerate(parameters.table(RobotModel(), node=1)):
        effect = "at once"
        if row.read_only:
            effect = "read-only"
        elif row.needs_reboot:
            effect = "at the next boot"
        yield ParameterRow(
            number,
            row.name,
            row.unit,
            row.kind.name.lower(),
            row.default,
            row.low,
            row.high,
            effect,
            row.doc,
        )


# ---- timing -------------------------------------------------------------------------------


def _ms(ns: float) -> str:
    return f"{ns / 1e6:g} ms"


def _us(us: float) -> str:
    return _ms(us * 1000)


def _rules() -> Iterator[TimingRule]:
    yield TimingRule(
        "device",
        "control period, and minimum period of a stream",
        _us(virtual_firmware.TICK_US),
        "sim_device.device.virtual_firmware.TICK_US",
    )
    yield TimingRule(
        "device",
        "period of `hello` until the handshake is complete",
        _us(virtual_firmware.HELLO_TICKS * virtual_firmware.TICK_US),
        "sim_device.device.virtual_firmware.HELLO_TICKS",
    )
    yield TimingRule(
        "device",
        "maximum time to live of a setpoint",
        _us(watchdog.MAX_TIME_TO_LIVE_US),
        "sim_device.device.watchdog.MAX_TIME_TO_LIVE_US",
    )
    yield TimingRule(
        "device",
        "no valid host frame: the session ends and a stop with cause `link` is latched after",
        _us(virtual_firmware.HOST_SILENCE_US),
        "sim_device.device.virtual_firmware.HOST_SILENCE_US",
    )
    yield TimingRule(
        "device",
        "maximum clock drift that the freshness check allows",
        f"{freshness.DRIFT_ALLOWANCE_PPM} ppm",
        "sim_device.device.freshness.DRIFT_ALLOWANCE_PPM",
    )
    yield TimingRule(
        "device",
        "stored replies for repeated commands",
        str(retransmission.REMEMBERED),
        "protocol.retransmission.REMEMBERED",
    )
    yield TimingRule(
        "device",
        "minimum time between two log texts",
        _us(log_lines.LOG_PERIOD_US),
        "sim_device.device.log_lines.LOG_PERIOD_US",
    )
    yield TimingRule(
        "device",
        "minimum rate of `sync`",
        f"{device_commands.SYNC_RATE_MIN / 10:g} Hz",
        "sim_device.device.commands.SYNC_RATE_MIN",
    )
    yield TimingRule(
        "device",
        "maximum duty in bring-up mode",
        f"{watchdog.BRINGUP_DUTY_MAX:g}",
        "sim_device.device.watchdog.BRINGUP_DUTY_MAX",
    )
    for what, us, source in (
        ("time from reset to the first control period", device.BOOT_US, "sweeper.BOOT_US"),
        ("watchdog reset of a program that hangs after", device.WATCHDOG_US, "sweeper.WATCHDOG_US"),
        (
            "own planner: standstill before the first leg",
            onboard.AT_REST_US,
            "device.onboard.AT_REST_US",
        ),
    ):
        yield TimingRule("device", what, _us(us), f"sim_device.{source}")
    yield from _host_rules()
    yield from _can_rules()


def _host_rules() -> Iterator[TimingRule]:
    for what, value, source in (
        (
            "period of `host_hello` until a device answers",
            session.HELLO_PERIOD_NS,
            "HELLO_PERIOD_NS",
        ),
        (
            "no device answers on the port: failed after",
            session.OPEN_TIMEOUT_NS,
            "OPEN_TIMEOUT_NS",
        ),
        (
            "handshake not complete: failed after",
            session.HANDSHAKE_TIMEOUT_NS,
            "HANDSHAKE_TIMEOUT_NS",
        ),
        ("no device frame: lost after", session.LOST_AFTER_NS, "LOST_AFTER_NS"),
        (
            f"period of the first {session.FAST_PINGS} time requests",
            session.FAST_PING_NS,
            "FAST_PING_NS",
        ),
        (
            "period of later time requests, which keep the session alive",
            session.SLOW_PING_NS,
            "SLOW_PING_NS",
        ),
    ):
        yield TimingRule("host", what, _ms(value), f"bridge.session.session.{source}")
    yield TimingRule(
        "host",
        f"maximum round-trip time for motion: minimum of the last {round_trip.PINGS} time "
        "requests, less the device's turnaround",
        _ms(round_trip.LIMIT_NS),
        "bridge.session.round_trip.LIMIT_NS",
    )
    yield TimingRule(
        "host",
        "stop with cause `link` if no reply arrives within that maximum for",
        _ms(round_trip.UNANSWERED_NS),
        "bridge.session.round_trip.UNANSWERED_NS",
    )
    yield TimingRule(
        "host",
        "maximum turnaround that is subtracted from a round trip",
        _ms(round_trip.TURNAROUND_NS),
        "bridge.session.round_trip.TURNAROUND_NS",
    )
    yield TimingRule(
        "host",
        "random advance of each time request, at most",
        _ms(session.PING_SPREAD_NS),
        "bridge.session.session.PING_SPREAD_NS",
    )
    yield TimingRule(
        "host",
        f"handshakes with a device that restarts: {session.HANDSHAKES_AT_ONCE} without delay, "
        "then one every",
        _ms(session.HANDSHAKE_PERIOD_NS),
        "bridge.session.session.HANDSHAKE_PERIOD_NS",
    )
    yield TimingRule(
        "host",
        "unanswered `describe` repeated after",
        _ms(session.ANSWER_PERIOD_NS),
        "bridge.session.session.ANSWER_PERIOD_NS",
    )
    yield TimingRule(
        "host",
        "maximum number of `describe` without an answer yet",
        str(session_negotiation.QUESTIONS_AT_ONCE),
        "bridge.session.negotiation.QUESTIONS_AT_ONCE",
    )
    yield TimingRule(
        "host",
        "period of setpoints",
        _ms(host.CONTROL_PERIOD_NS),
        "bridge.run.host.CONTROL_PERIOD_NS",
    )
    yield TimingRule(
        "host",
        "time to live of a setpoint",
        f"{host.SETPOINT_TTL_MS} ms",
        "bridge.run.host.SETPOINT_TTL_MS",
    )
    yield TimingRule(
        "host",
        "maximum age of a setpoint that is sent",
        _ms(host.LATE_NS),
        "bridge.run.host.LATE_NS",
    )
    for what, value, source in (
        (
            "timeout of a session's first command",
            retransmission.FIRST_TIMEOUT_US,
            "FIRST_TIMEOUT_US",
        ),
        (
            "minimum timeout from the measured round trip (RFC 6298)",
            retransmission.MIN_TIMEOUT_US,
            "MIN_TIMEOUT_US",
        ),
        (
            "maximum timeout; it doubles with each attempt",
            retransmission.MAX_TIMEOUT_US,
            "MAX_TIMEOUT_US",
        ),
    ):
        yield TimingRule("host", what, _us(value), f"protocol.retransmission.{source}")
    yield TimingRule(
        "host",
        "attempts for a command; a stop is repeated until acknowledged",
        str(retransmission.MAX_TRIES),
        "protocol.retransmission.MAX_TRIES",
    )


def _can_rules() -> Iterator[TimingRule]:
    for what, value, source in (
        ("maximum age of a short stamp", can_stamps.OLDEST_US, "can.stamps.OLDEST_US"),
        ("an incomplete transfer is dropped after", can_segments.OPEN_US, "can.transfers.OPEN_US"),
        (
            "an identical frame counts as a duplicate within",
            can_link.DUPLICATE_US,
            "can.link.DUPLICATE_US",
        ),
    ):
        yield TimingRule("both, on CAN", what, _us(value), f"protocol.{source}")
    yield TimingRule(
        "host, on CAN",
        "time for other devices to answer after the first hello",
        _ms(session_bus.ANSWERS_NS),
        "bridge.session.discovery.ANSWERS_NS",
    )


def _numbers() -> dict[str, str]:
    return {
        "control_ms": f"{host.CONTROL_PERIOD_NS / 1e6:g}",
        "ttl_ms": str(host.SETPOINT_TTL_MS),
        "late_ms": f"{host.LATE_NS / 1e6:g}",
        "stuck_ms": f"{pump.STUCK_NS / 1e6:g}",
        "max_ttl_ms": f"{watchdog.MAX_TIME_TO_LIVE_US / 1000:g}",
        "tick_ms": f"{1000 / streams.TICK_HZ:g}",
        "decel": f"{parameters.STOP_DECELERATION_M_S2:g}",
        "silence_s": f"{virtual_firmware.HOST_SILENCE_US / 1e6:g}",
    }
