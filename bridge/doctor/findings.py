"""Kinds of findings of the doctor, each with its remedy."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.session.records import Severity

ADVICE: Mapping[str, str] = MappingProxyType(
    {
        "no_data": "check that the device has power, that RX and TX are crossed, and that this is "
        "the right port (sweepctl ports)",
        "no_answer": "the device sends but does not answer; check the wire from the host's TX to "
        "the device's RX, and that no serial console uses the device's receiver",
        "waiting": "run the doctor without --listen; without a handshake a sweeper sends only a "
        "hello each second",
        "wrong_baud": "find the rate with --find-baud and set --baud to it, or check that the "
        "device is a sweeper",
        "echo": "RX and TX are connected to each other, or the adapter echoes; separate the wires "
        "or turn the echo off",
        "other_node": "set --node to the number of the device that answers, or omit --node",
        "words": "another program uses this port; stop it, or choose another port",
        "version": "update the firmware or sweepctl, whichever is older",
        "schema": "update the firmware or sweepctl, whichever is older; only the messages that "
        "differ are disabled",
        "line_noise": "shorten and shield the cable, connect the grounds, route it away from the "
        "motor leads, add ferrites or lower --baud; check whether the errors occur only while "
        "the motors run",
        "overrun": "bytes are dropped before they are read; on the host, close programs that keep "
        "it busy and avoid full hubs; on the device, check for a baud rate too low for its "
        "streams (sweepctl param, stream rates) or a receive buffer that is too small",
        "repeated": "a driver or adapter delivers packets twice; update it, or try another hub or "
        "adapter",
        "device_receives_noise": "the bytes from the host arrive damaged at the device; check that "
        "wire, its level (3.3 V or 5 V) and the ground",
        "late_setpoints": "the device dropped velocity setpoints because they were too old; see "
        "the findings latency and host_stall",
        "gap": "the link was silent for a while; check for a loose plug, a radio link or a busy "
        "device, and move the cable while you watch. In a recovered log, a gap is data that was "
        "lost",
        "unplugged": "the port disappeared; check the plug and the hub's power, and the kernel "
        "log (dmesg) for a driver reset",
        "host_stall": "this computer did not read the port for a while; stop programs that load "
        "it, do not suspend its virtual machine, or raise the priority of the bridge. The data "
        "arrived late; none was lost",
        "latency": "data arrives later than with a good adapter; set the adapter to low-latency "
        "mode, avoid hubs, radio links and network bridges, and check the load of this computer",
        "adapter_latency": "the latency timer of the adapter delays the bytes; set it to 1 ms "
        "(Linux: setserial PORT low_latency, or echo 1 > "
        "/sys/bus/usb-serial/devices/NAME/latency_timer; Windows: the port's advanced settings)",
        "clock_step": "the device clock jumped relative to the host clock; check for firmware "
        "that sets its timer, and for a host clock that was stepped or suspended. Poses near the "
        "jump are uncertain",
        "clock_drift": "the clocks differ by more than the tolerance of crystals; the device runs "
        "from its RC oscillator (HSE did not start), or the prescaler of its timer is wrong",
        "reset": "the device rebooted while it was in use; see the reset cause",
        "watchdog": "the firmware hung until the watchdog reset it; look for a call that blocks "
        "the loop, first of all one that waits for the I2C bus without a timeout",
        "crash": "the processor faulted; look up the program counter (pc) and the link register "
        "(lr) of the record in the firmware's ELF file with addr2line",
        "oscillator": "the crystal does not run, so the device uses its internal oscillator and "
        "keeps its CAN controller off; check the crystal, its capacitors and, on a NUCLEO board, "
        "the clock from the ST-LINK",
        "queue_full": "a queue of the device was full; lower the stream rates, raise the baud rate "
        "or the bit rate, or enlarge the firmware's buffers",
        "bus_off": "the CAN controller disconnected after too many errors; check the termination "
        "(120 ohm at both ends), that all nodes have the same bit rate, and the wiring",
        "can_errors": "the CAN controller is error passive; check the termination (120 ohm at both "
        "ends), that all nodes have the same bit rate, and that another node acknowledges",
        "brown_out": "the supply voltage fell too low; check for a weak battery or converter, "
        "thin leads, and motor current on the logic rail; add a capacitor at the board, or "
        "separate the supplies",
        "overload": "the control loop of the firmware has almost no time left; lower the stream "
        "rates, or find the slow part of the loop",
        "stopped": "the robot does not move until the stop is cleared; make sure that it is safe, "
        "then add --clear-stop",
        "stall": "a wheel was blocked or its gearbox is jammed; free it, then run bringup",
        "slip": "a wheel slips (floor, worn tyre, an object under it), an encoder misses counts "
        "(plug, disc), or the ultrasonic sensor reads wrong distances",
        "tilt": "the robot tilted, or the accelerometer is not level; put it on level floor, then "
        "calibrate",
        "lifted": "the robot was lifted; put it down and clear the stop",
        "bump": "the robot bumps more often than it should, or a bumper switch is stuck; press "
        "both switches by hand and watch them in monitor",
        "cliff": "the cliff sensor saw no floor; check for stairs, and for a sensor that is dirty "
        "or mounted too high",
        "battery": "charge the battery; if it is charged, measure it under load and check its "
        "leads",
        "disagreement": "the reports of the device's planner contradict its sensor readings; "
        "compare the robot file with the device's parameters (sweepctl param), then check the "
        "firmware",
        "sensor": "the device reports this sensor as faulty; check its plug and supply, then run "
        "bringup",
        "imu": "the inertial sensor is stuck or its offset has changed; check its bus and supply, "
        "and calibrate it after a shock or a change of temperature",
        "adc": "the device repeats its readings of supply and motor currents, so neither a low "
        "battery nor a stalled motor is noticed; restart it, then check the converter and its DMA "
        "channel in the firmware",
        "truncated": "the log is still being written, or its writer was killed, or the disk was "
        "full; sweepctl recover saves the intact part",
        "damaged_log": "sweepctl recover saves the intact part",
        "not_recorded": "record with sweepctl connect, which keeps every byte; without the bytes "
        "the link and the clock cannot be judged",
        "topic_gap": "the program that wrote this topic paused or lost messages; see its own log",
    }
)


@dataclass(frozen=True, slots=True)
class Finding:
    """One fault or note, with its measured values."""

    kind: str
    severity: Severity
    text: str
    data: dict[str, Any] = field(default_factory=dict)

    @property
    def advice(self) -> str:
        """The remedy."""
        return ADVICE[self.kind]

    def as_json(self) -> dict[str, Any]:
        """Return the finding as a JSON object."""
        return {
            "kind": self.kind,
            "severity": self.severity.value,
            "text": self.text,
            "advice": self.advice,
            "data": self.data,
        }
