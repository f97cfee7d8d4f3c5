"""Rules of the doctor, which derive findings from the examined link, robot and session."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from bridge.doctor.body_view import BodyView
from bridge.doctor.findings import Finding
from bridge.doctor.timing import HOLE_S, Timing, measure
from bridge.doctor.wire_view import WireView
from bridge.session.diagnosis import Evidence, text_line
from bridge.session.event_kinds import EventKind
from bridge.session.records import Severity
from protocol.link import Medium
from protocol.messages.values import Fault, ResetCause, StopCause, label
from protocol.schema.catalogue import CATALOGUE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bridge.doctor.body_view import Sign
    from bridge.doctor.wire_view import Boot

MIN_DAMAGED = 3
"""Minimum number of damaged frames for a finding. The first bytes after the port is opened are
usually the end of a frame."""
STRANGE_BYTES = 1000
"""Number of damaged bytes not similar to a message above which the baud rate is probably wrong."""
STRANGE_TIMES = 10
"""Minimum ratio of these bytes to the other damaged bytes for the same conclusion."""
MIN_PIECE = 10
"""Minimum number of consecutive missing frames that count as a gap. A full buffer drops fewer
frames."""
NOISE_SHARE = 1e-4
"""Share of damaged frames below which the finding about noise is only a note."""
LATE_P95_MS = 5.0
"""Maximum normal 95th percentile of the delay, ms. It is below 2 ms for an idle host and an adapter
with a latency of 1 ms."""
ROUND_TRIP_MS = 8.0
"""Maximum normal median of the round-trip time, ms. It is below 4 ms for an idle host and an
adapter with a latency of 1 ms."""
DRIFT_PPM = 200.0
"""Maximum normal clock drift, ppm. It is for two crystals of ±100 ppm."""
LOGIC_V = 4.5
"""Lower limit of the 5 V rail, V."""
LOAD_PERCENT = 90
"""Minimum load of the device's control loop that is reported, percent."""
CAN_ERROR_PASSIVE = 128
"""Minimum value of an error counter at which a CAN controller is error passive (ISO 11898-1)."""
STALE_SHARE = 0.02
"""Minimum share of stale setpoints that is reported, among the frames that the device received."""
_FAULTY_RESETS = frozenset({ResetCause.BROWN_OUT, ResetCause.WATCHDOG, ResetCause.CRASH})
"""Reset causes for which there is a finding of the same name."""
_SHOWN = 3
"""Number of schema differences in a finding's text."""
_CONTACT = frozenset(
    {"no_data", "wrong_baud", "no_answer", "echo", "other_node", "words", "version"}
)
"""Session failures whose finding has the same name."""
_FINDING_OF: dict[str, str] = {
    EventKind.SILENCE: "no_data",
    EventKind.GARBAGE: "wrong_baud",
    EventKind.TRANSMIT_ONLY: "no_answer",
}
"""Map of session failure to finding, if their names differ."""
_WARN, _BAD, _NOTE = Severity.WARNING, Severity.ERROR, Severity.INFO


@dataclass
class Examination:
    """One capture and everything known about it; :meth:`conclude` returns the findings."""

    medium: Medium = Medium.UART
    raw: bool = True
    """True if the capture contains raw bytes; False: only decoded messages."""
    failure: tuple[str, str] | None = None
    """Kind and text of the session's failure."""
    differences: list[str] = field(default_factory=list)
    """Differences between the catalogues of host and device, one line each."""
    boots: list[Boot] = field(default_factory=list)
    """Additional boots that a log contains."""
    port_lost: list[str] = field(default_factory=list)
    """Error text of each loss of the port."""
    extra: list[Finding] = field(default_factory=list)
    """Findings about the file or the port."""

    def __post_init__(self) -> None:
        """Create the examiners of link and robot."""
        self.wire = WireView(self.medium)
        self.body = BodyView()
        self.wire.on_message = self.body.take
        self.timing = Timing()

    def received(self, data: bytes, at_ns: int) -> None:
        """Handle bytes from the device."""
        self.wire.received(data, at_ns)

    def sent(self, data: bytes, at_ns: int) -> None:
        """Handle bytes that were sent to the device."""
        self.wire.sent(data, at_ns)
        self.body.onboard = self.wire.onboard or self.body.onboard

    def conclude(self) -> list[Finding]:
        """Return all findings, the most severe first."""
        self.timing = measure(self.wire)
        found = [*self.extra]
        for rule in (
            self._contact,
            self._damage,
            self._losses,
            self._delays,
            self._clock,
            self._resets,
            self._device,
            self._body,
        ):
            found += rule()
        order = {Severity.ERROR: 0, Severity.WARNING: 1, Severity.INFO: 2, Severity.DEBUG: 3}
        return sorted(found, key=lambda finding: order[finding.severity])

    # ---- rules ----------------------------------------------------------------------------

    def _contact(self) -> Iterator[Finding]:
        """Check that the device is a sweeper and compatible."""
        wire = self.wire
        if self.failure is not None:
            kind, text = self.failure
            kind = _FINDING_OF.get(kind, kind)
            if kind in _CONTACT:
                yield Finding(kind, _BAD, text)
                return
            yield Finding("schema" if kind == EventKind.INCOMPATIBLE else "no_answer", _BAD, text)
        elif self.raw and wire.bytes_in == 0:
            yield Finding("no_data", _BAD, "no bytes were received from the device")
        elif wire.versions and wire.frames == 0:
            spoken = ", ".join(map(str, sorted(wire.versions)))
            yield Finding("version", _BAD, f"the device uses protocol version {spoken}")
        elif self.raw and wire.frames == 0:
            yield self._garbage()
        elif self.medium is Medium.UART and self._mostly_garbage():
            share = wire.damaged.total / (wire.damaged.total + wire.frames)
            yield Finding(
                "wrong_baud",
                _BAD,
                f"{100 * share:.0f} % of the received data is no valid frame, and most of it "
                "resembles no message: for part of the time the baud rates differed",
                {"damaged": wire.damaged.total, "frames": wire.frames},
            )
        elif wire.streams.keys() == {"hello"}:
            text = "only hellos were received: the device waits for a host"
            yield Finding("waiting", _NOTE, text, {"hellos": wire.frames})
        if self.differences:
            yield Finding(
                "schema",
                _WARN,
                f"host and device declare {len(self.differences)} messages differently: "
                + "; ".join(self.differences[:_SHOWN]),
                {"differences": self.differences},
            )
        elif wire.boots and wire.boots[-1].catalogue_hash != CATALOGUE.hash:
            yield Finding(
                "schema",
                _WARN,
                f"the device's catalogue is {wire.boots[-1].catalogue_hash:08x}, "
                f"this program's {CATALOGUE.hash:08x}",
            )

    def _garbage(self) -> Finding:
        evidence = Evidence()
        evidence.add(self.wire.beginning)
        kind, text = evidence.verdict(self.medium, self.wire.damaged.total)
        return Finding(_FINDING_OF.get(kind, kind), _BAD, text, {"bytes": self.wire.bytes_in})

    def _is_rejected(self) -> bool:
        """Return whether the server rejected the connection with a line of text."""
        return self.wire.frames == 0 and text_line(self.wire.beginning) is not None

    def _mostly_garbage(self) -> bool:
        damaged = self.wire.damaged
        strange = damaged.unknown_bytes
        return strange > STRANGE_BYTES and strange > STRANGE_TIMES * (damaged.bytes - strange)

    def _damage(self) -> Iterator[Finding]:
        """Classify damage by the headers of the damaged frames."""
        wire, damaged = self.wire, self.wire.damaged
        if wire.repeated >= MIN_DAMAGED:
            text = f"{wire.repeated} frames were received twice"
            yield Finding("repeated", _WARN, text, {"repeated": wire.repeated})
        judged = damaged.whole + damaged.short + damaged.long
        if damaged.total < MIN_DAMAGED or judged < MIN_DAMAGED or wire.frames == 0:
            return
        if 2 * wire.repeated > damaged.total:
            return  # the damaged frames are parts of the duplicates
        share = damaged.total / (wire.frames + damaged.total)
        data: dict[str, Any] = {
            "damaged": damaged.total,
            "frames": wire.frames,
            "right_length": damaged.whole,
            "too_short": damaged.short,
            "too_long": damaged.long,
        }
        severity = _NOTE if share < NOISE_SHARE else _WARN
        of = f"{damaged.total} of {wire.frames + damaged.total} frames"
        if damaged.short > damaged.whole:
            text = f"{of} arrived damaged, most of them too short: bytes are lost on the link"
            yield Finding("overrun", severity, text, data)
        else:
            text = f"{of} arrived damaged without missing bytes: bits are flipped"
            yield Finding("line_noise", severity, text, data)

    def _losses(self) -> Iterator[Finding]:
        """Find lost frames and gaps."""
        wire, holes = self.wire, self.timing.holes
        in_holes = sum(hole.missing for hole in holes)
        if self.port_lost and not self._is_rejected():
            text = f"the port disappeared {_times(len(self.port_lost))}: {self.port_lost[0]}"
            yield Finding("unplugged", _BAD, text, {"times": len(self.port_lost)})
        boots = [boot.at_ns for boot in wire.boots[1:]]
        begin_ns = wire.marks.arrived_ns[0] if wire.marks.arrived_ns else 0
        own = [
            hole
            for hole in holes
            if not _near_boot(hole.at_s, hole.for_s, boots, begin_ns)
            # Before the handshake a device sends only one hello per second.
            and begin_ns + hole.at_s * 1e9 >= wire.streaming_ns
        ]
        if own and not self.port_lost:
            longest = max(own, key=lambda hole: hole.for_s)
            text = (
                f"nothing was received {_times(len(own))}; the longest gap was "
                f"{longest.for_s:.2f} s at {longest.at_s:.1f} s"
            )
            data = {"holes": [(hole.at_s, hole.for_s) for hole in own[:50]]}
            yield Finding("gap", _WARN, text, data)
        elsewhere = wire.lost - in_holes - wire.damaged.total
        few_damaged = wire.damaged.total < MIN_DAMAGED  # else there is a finding about damage
        if elsewhere > max(MIN_DAMAGED, NOISE_SHARE * wire.frames) and few_damaged:
            yield self._missing(elsewhere)
        if wire.device_damaged >= MIN_DAMAGED and not self._mostly_garbage():
            # With different baud rates both ends receive damaged frames.
            text = f"the device counted {wire.device_damaged} damaged frames from the host"
            yield Finding("device_receives_noise", _WARN, text, {"damaged": wire.device_damaged})
        if wire.device_stale > max(MIN_DAMAGED, STALE_SHARE * wire.device_received):
            text = f"the device dropped {wire.device_stale} setpoints as stale or duplicate"
            yield Finding("late_setpoints", _WARN, text, {"stale": wire.device_stale})

    def _missing(self, elsewhere: int) -> Finding:
        """Classify missing sequence numbers: consecutive numbers are a gap, others an overrun."""
        wire, marks = self.wire, self.wire.marks
        data: dict[str, Any] = {"lost": wire.lost, "frames": wire.frames}
        short = [
            (skipped, index)
            for index, skipped in enumerate(marks.skipped)
            if index and marks.arrived_ns[index] - marks.arrived_ns[index - 1] <= HOLE_S * 1e9
        ]
        piece, index = max(short, default=(0, 0))
        if piece < MIN_PIECE or 2 * piece < elsewhere:
            text = f"{wire.lost} frames are missing by their sequence numbers, "
            text += f"{wire.damaged.total or 'none'} of them arrived damaged"
            return Finding("overrun", _WARN, text, data)
        at_s = (marks.arrived_ns[index - 1] - marks.arrived_ns[0]) * 1e-9
        share = 100.0 * wire.lost / (wire.frames + wire.lost)
        text = f"{wire.lost} frames are missing by their sequence numbers ({share:.1f} %), "
        text += f"{piece} of them consecutive at {at_s:.1f} s"
        return Finding("gap", _WARN, text, data | {"piece": piece, "at_s": round(at_s, 3)})

    def _delays(self) -> Iterator[Finding]:
        """Find delays and their probable cause."""
        timing = self.timing
        stalls = timing.stalls
        if stalls:
            worst = max(stalls, key=lambda stall: stall.for_s)
            text = (
                f"the host stopped reading {_times(len(stalls))}; the longest stall was "
                f"{worst.for_s:.2f} s at {worst.at_s:.1f} s"
            )
            data = {"stalls": [(stall.at_s, stall.for_s) for stall in stalls[:50]]}
            yield Finding("host_stall", _WARN, text, data)
        late_ms = timing.delay_ms.get("p95", 0.0)
        trip_ms = timing.round_trip_ms.get("p50", 0.0)
        slower = [s for s in timing.steps if _is_line(s.by_ms, s.round_trip_ms) and s.by_ms > 0.0]
        if late_ms <= LATE_P95_MS and trip_ms <= ROUND_TRIP_MS and not slower:
            return
        figures = {**{f"delay_{k}_ms": round(v, 2) for k, v in timing.delay_ms.items()}}
        figures |= {f"round_trip_{k}_ms": round(v, 2) for k, v in timing.round_trip_ms.items()}
        timer_ms = timing.timer_ms
        if timer_ms is not None and late_ms > max(LATE_P95_MS, 0.5 * timer_ms) and not slower:
            figures["timer_ms"] = round(timer_ms, 2)
            text = f"a latency timer of {timer_ms:.0f} ms delays the bytes"
            yield Finding("adapter_latency", _WARN, text, figures)
            return
        judged = [f"5 % of the frames arrive more than {late_ms:.0f} ms late"] if late_ms else []
        if trip_ms:
            judged.append(f"the median round trip is {trip_ms:.1f} ms")
        if slower:
            judged.append(
                f"at {slower[0].at_s:.1f} s the delay increased by {slower[0].by_ms:.0f} ms"
            )
        yield Finding("latency", _WARN, "; ".join(judged), figures)

    def _clock(self) -> Iterator[Finding]:
        """Find steps and drift of the device clock."""
        timing = self.timing
        jumps = [s for s in timing.steps if not _is_line(s.by_ms, s.round_trip_ms)]
        if jumps:
            first = jumps[0]
            text = (
                f"the device clock jumped {_times(len(jumps))} relative to the host clock, "
                f"first by {-first.by_ms:+.0f} ms at {first.at_s:.1f} s"
            )
            data = {"jumps": [(s.at_s, round(-s.by_ms, 1)) for s in jumps[:50]]}
            yield Finding("clock_step", _WARN, text, data)
        drift, error = timing.drift_ppm, timing.drift_error_ppm
        if drift is not None and error is not None and abs(drift) - error > DRIFT_PPM:
            how = "slow" if drift > 0.0 else "fast"
            text = f"the device's clock is {how} by {abs(drift):.0f} ppm (± {error:.0f})"
            figures = {"ppm": round(-drift, 1), "error_ppm": round(error, 1)}
            yield Finding("clock_drift", _WARN, text, figures)

    def _resets(self) -> Iterator[Finding]:
        """Find reboots during the capture and their causes."""
        boots = self.wire.boots or self.boots
        again = boots[1:]
        if again:
            causes = Counter(label(ResetCause, boot.cause) for boot in again)
            judged = ", ".join(f"{name} ({count})" for name, count in causes.items())
            kind = "reset"
            if ResetCause.BROWN_OUT in {boot.cause for boot in again}:
                kind = "brown_out"
            elif ResetCause.CRASH in {boot.cause for boot in again}:
                kind = "crash"
            elif ResetCause.WATCHDOG in {boot.cause for boot in again}:
                kind = "watchdog"
            record = f"; record: {self.wire.crash}" if self.wire.crash else ""
            text = f"the device rebooted {_times(len(again))}; cause: {judged}{record}"
            yield Finding(kind, _BAD, text, {"causes": dict(causes)})
        elif boots and boots[0].cause in _FAULTY_RESETS:
            kind = label(ResetCause, boots[0].cause)
            record = f"; record: {self.wire.crash}" if self.wire.crash else ""
            text = f"the reset cause before the capture was {kind}{record}"
            yield Finding(kind, _NOTE, text, {"before": True})
        low_v = self.wire.logic_low_v
        if low_v is not None and low_v < LOGIC_V:
            text = f"the 5 V rail fell to {low_v:.2f} V"
            yield Finding("brown_out", _BAD, text, {"logic_v": round(low_v, 3)})

    def _device(self) -> Iterator[Finding]:
        """Find overload, full queues, CAN errors, a failed crystal and a latched stop."""
        wire = self.wire
        if wire.faults & Fault.CLOCK:
            yield Finding("oscillator", _BAD, "the device's crystal does not run")
        dropped = wire.device_receive_dropped + wire.device_send_dropped
        if dropped:
            text = (
                f"the device dropped {wire.device_receive_dropped} received and "
                f"{wire.device_send_dropped} outgoing messages because a queue was full"
            )
            data = {"received": wire.device_receive_dropped, "sent": wire.device_send_dropped}
            yield Finding("queue_full", _WARN, text, data)
        if wire.can_bus_offs:
            text = f"the device's CAN controller went bus-off {_times(wire.can_bus_offs)}"
            yield Finding("bus_off", _BAD, text, {"times": wire.can_bus_offs})
        elif wire.can_errors >= CAN_ERROR_PASSIVE:
            text = f"an error counter of the device's CAN controller reached {wire.can_errors}"
            yield Finding("can_errors", _WARN, text, {"errors": wire.can_errors})
        if wire.load_percent >= LOAD_PERCENT:
            text = f"the load of the device's control loop reached {wire.load_percent} %"
            yield Finding("overload", _WARN, text, {"load_percent": wire.load_percent})
        cause = wire.stop_cause
        if cause is not None and cause > StopCause.SESSION_END:
            text = f"at the end a stop was latched, cause: {label(StopCause, cause)}"
            yield Finding("stopped", _NOTE, text, {"cause": label(StopCause, cause)})

    def _body(self) -> Iterator[Finding]:
        """Report each kind of robot fault once, with its first occurrence and its count."""
        signs: dict[str, list[Sign]] = {}
        for sign in self.body.signs:
            signs.setdefault(sign.kind, []).append(sign)
        for kind, found in signs.items():
            first = found[0]
            often = "" if len(found) == 1 else f" ({len(found)} findings of this kind)"
            text = f"at {first.at_s:.1f} s {first.text}{often}"
            data = {**first.data, "at_s": first.at_s, "times": len(found)}
            yield Finding(kind, _WARN, text, data)

    # ---- figures --------------------------------------------------------------------------

    def figures(self) -> dict[str, Any]:
        """Return the measurements as a JSON object."""
        wire, timing = self.wire, self.timing
        return {
            "duration_s": round(max(timing.duration_s, wire.heard_s), 3),
            "bytes": {"in": wire.bytes_in, "out": wire.bytes_out},
            "frames": wire.frames,
            "lost": wire.lost,
            "damaged": wire.damaged.total,
            "repeated": wire.repeated,
            "unused": dict(wire.foreign),
            "delay_ms": {k: round(v, 3) for k, v in timing.delay_ms.items()},
            "round_trip_ms": {k: round(v, 3) for k, v in timing.round_trip_ms.items()},
            "drift_ppm": None if timing.drift_ppm is None else round(-timing.drift_ppm, 2),
            "drift_error_ppm": (
                None if timing.drift_error_ppm is None else round(timing.drift_error_ppm, 2)
            ),
            "boots": [
                {
                    "boot_id": f"{boot.boot_id:08x}",
                    "cause": label(ResetCause, boot.cause),
                    "firmware": boot.firmware,
                    "uid": boot.uid.hex(),
                }
                for boot in (wire.boots or self.boots)
            ],
            "streams": {
                name: {
                    "count": stream.count,
                    "rate_hz": None if stream.rate_hz is None else round(stream.rate_hz, 2),
                    "default_hz": stream.default_hz,
                    "longest_gap_s": round(stream.longest_ns * 1e-9, 3),
                }
                for name, stream in sorted(wire.streams.items())
            },
        }


def _is_line(by_ms: float, round_trip_ms: float | None) -> bool:
    """Return True if the round trip changed with the offset: the link's delay changed."""
    if round_trip_ms is None:
        return False
    return round_trip_ms * by_ms > 0.0 and abs(round_trip_ms) > 0.5 * abs(by_ms)


def _near_boot(at_s: float, for_s: float, boots: list[int], begin_ns: int) -> bool:
    end_s = at_s + for_s
    return any(at_s - 0.1 <= (boot - begin_ns) * 1e-9 <= end_s + 2.0 for boot in boots)


def _times(count: int) -> str:
    return "once" if count == 1 else "twice" if count == 2 else f"{count} times"  # noqa: PLR2004
