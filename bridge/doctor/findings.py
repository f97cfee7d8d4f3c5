"""What the doctor may say: each kind of trouble with what it means and what to do about it."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.session.records import Severity

ADVICE: Mapping[str, str] = MappingProxyType(
    {
        "no_data": "check power, the cable, that RX and TX are crossed, and that this is the "
        "right port (sweepctl ports)",
        "no_answer": "the device is heard and does not answer: check the wire from this host's "
        "TX to its RX, and that a serial console does not hold its receiver",
        "waiting": "leave out --listen, and it is asked; until a host agrees with it, a sweeper "
        "says no more than that it is there",
        "wrong_baud": "open it at the rate of the firmware with --baud, or see whether this is a "
        "sweeper at all",
        "echo": "RX and TX are joined, or the adapter echoes: part them, turn echo off",
        "other_node": "give --node the number that is heard, or leave --node out",
        "words": "something else is on this port: end it, or choose another port",
        "version": "update the older of the two: firmware or sweepctl",
        "schema": "update the older of the two; what differs is not used, the rest works",
        "line_noise": "shorten and shield the cable, join the grounds, keep it off the motors' "
        "leads, put ferrites or lower --baud; look whether it comes with the motors",
        "overrun": "bytes are dropped before they are read: at the host end other programs that "
        "keep it busy, a hub that is full; at the device too low a baud rate for its streams "
        "(sweepctl param, stream rates) or a receive buffer that is too small",
        "repeated": "a driver or adapter hands on packets twice: update it, or try another hub "
        "or adapter",
        "device_hears_noise": "the host's bytes reach the device damaged: the other wire of the "
        "pair, its level (3.3 V against 5 V) and ground",
        "late_setpoints": "the device refused velocities as too old: something holds them up on "
        "the way to it; see latency and host_stall",
        "gap": "the line was silent and came back: a loose plug, a radio link, or a device that "
        "was busy; move the cable and see. In a log that was recovered: what was left out",
        "unplugged": "the port went away: a plug, a hub's power, or a driver that reset it; see "
        "the kernel's log (dmesg)",
        "host_stall": "this computer did not read for a while: end what loads it, do not run the "
        "bridge in a virtual machine that is suspended, raise its priority; the device's data "
        "were late, none was lost",
        "latency": "data are late by more than a good adapter makes them: put the adapter in "
        "low-latency mode, leave out hubs, radio links and network bridges; a computer that is "
        "busy reads late too: see its load",
        "adapter_latency": "the adapter's latency timer holds bytes back: set it to 1 ms (Linux: "
        "setserial PORT low_latency, or echo 1 > /sys/bus/usb-serial/devices/NAME/latency_timer; "
        "Windows: the port's advanced settings)",
        "clock_step": "the device's clock jumped against the host's: a firmware that sets its "
        "timer, or a host whose clock was stepped or suspended; poses around it are unsure",
        "clock_drift": "the two clocks run apart by more than crystals do: the device runs from "
        "its RC oscillator (HSE not started), or its timer's prescaler is wrong",
        "reset": "the device booted anew while it was in use; see its cause",
        "watchdog": "the firmware hung until its watchdog reset it: look for what blocks its "
        "loop, an I2C bus that waits for ever above all",
        "brown_out": "its supply fell too low: a weak battery or converter, thin leads, or the "
        "motors' current on the logic's rail; add a capacitor at the board, part the supplies",
        "overload": "the firmware's control loop has hardly any time left: lower stream rates, "
        "look for what takes so long",
        "stopped": "it will not move before the stop is cleared: see that it is safe, then add "
        "--clear-stop",
        "stall": "a wheel was held or its gearbox is jammed; free it, then try bringup",
        "slip": "a wheel slips (floor, worn tyre, something under it), an encoder misses counts "
        "(its plug, its disc), or the ultrasonic sensor does not tell the truth",
        "tilt": "it leaned, or the accelerometer is not level: see how it stands, then calibrate",
        "lifted": "somebody took it up; put it down and clear the stop",
        "bump": "it bumps more than it should, or a bumper is stuck: press both halves by hand "
        "and look at them in monitor",
        "cliff": "it saw no floor: stairs, or a cliff sensor that is dirty or hangs too high",
        "battery": "charge it; if it is charged, measure it under load and see its leads",
        "disagreement": "the device's planner says what its readings do not bear out: see that "
        "robot file and the device's parameters agree (sweepctl param), then its firmware",
        "sensor": "the device itself holds this sensor broken: see its plug and supply, "
        "then bringup",
        "imu": "the inertial sensor is stuck or shifted: see its bus and supply; after a shock "
        "or a change of temperature calibrate it",
        "truncated": "the program that wrote the log was killed or the disk was full; "
        "sweepctl recover saves what is whole",
        "damaged_log": "sweepctl recover saves what is whole",
        "not_recorded": "sweepctl connect records every byte; this log does not have them, so "
        "line and clock cannot be judged",
        "topic_gap": "whoever wrote this topic paused or lost messages: see the program's own log",
    }
)


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong, or worth knowing."""

    kind: str
    severity: Severity
    text: str
    data: dict[str, Any] = field(default_factory=dict)

    @property
    def advice(self) -> str:
        """What to do about it."""
        return ADVICE[self.kind]

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        return {
            "kind": self.kind,
            "severity": self.severity.value,
            "text": self.text,
            "advice": self.advice,
            "data": self.data,
        }
