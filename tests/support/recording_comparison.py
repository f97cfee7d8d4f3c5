"""Record the inputs of the C core's board in a run, and replay them to both firmwares, open loop.

A recording contains all data between the board and the firmware: received bytes with their times,
encoder counts, registers of the IMU, ranges, contacts, the ADC's readings, boots and resets. The
outputs do not affect later inputs. So if the outputs differ, the firmwares differ; a different path
of the robot cannot be the cause.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from bridge.run.mission import Resume
from protocol.can.link import CanLink
from protocol.link import Received
from protocol.messages.device import Hello, TimeReply
from protocol.messages.values import Capability, Contact, RebootKind, ResetCause
from protocol.schema.message import Direction
from protocol.uart.link import Link
from sim_device.core.chip import Ask, LocalChip, Operation
from sim_device.core.core_firmware import BOOT, POLL, POWER, RANGES, RECEIVE, STATES, View, view_of
from sim_device.core.core_sweeper import CoreSweeper
from sim_device.device.counters import LineHealth
from sim_device.device.flash import Flash
from sim_device.device.identity import CrashRecord, Identity
from sim_device.device.virtual_firmware import Firmware
from sim_device.faults.kinds import parse_fault
from sim_device.sensors.contacts import Bumpers
from sim_device.sensors.imu import ImuCounts
from sim_device.sensors.power_monitor import PowerReading
from sim_device.sensors.rangers import Ranges
from support.script_format import NO_RANGE
from support.scripted_model import pieces, seen
from tools.cli.rooms import load_room
from tools.virtual.run import run_virtual

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from bridge.floor_plan.floor_plan import FloorPlan
    from protocol.link import LinkBase

_DUTY_ONE = 10_000
HEAD_VALUES = len(RECEIVE.unpack(bytes(RECEIVE.size)))
"""Number of values at the beginning of a POLL payload, before the encoder counts. They equal the
values of a RECEIVE payload.
"""
_BORDER = frozenset({Operation.POLL, Operation.RECEIVE, Operation.BOOT})
"""Operations after which the firmware's state and output are compared."""

BOUNDS = {
    "duty": (1, "single against double precision: a step of the bridge's timer, 1/10 000"),
    "power.motor_left": (1, "a current between two steps: up in the core, to even in the model"),
    "power.motor_right": (1, "a current between two steps: up in the core, to even in the model"),
    "status.load": (4, "the model counts received frames too, and begins with a full interval"),
    "time_reply.sent": (1, "the core adds the time until the line is idle, at most 1 us here"),
}
"""Largest allowed difference of a field, in its wire steps, with the cause. All other fields must
be equal. Readings, setpoints and streams are integers. Only the wheel controller computes with
fractions: in single precision in the core, in double precision in the model.
"""


# ---- recording -------------------------------------------------------------------------------


class Call(NamedTuple):
    """A call of the chip: operation, payload, values that the call requested, and reply."""

    operation: int
    payload: bytes
    answers: list[tuple[int, bytes]]
    reply: bytes


@dataclass(frozen=True, slots=True)
class Recording:
    """Inputs and outputs of the C core in a run."""

    model: RobotModel
    can: bool = False
    key: bytes | None = None
    calls: list[Call] = field(default_factory=list)


class RecordingChip:
    """The built-in core on a virtual board that records all calls."""

    def __init__(self, answer: Callable[[int], bytes], recording: Recording) -> None:
        self._answer, self._recording = answer, recording
        self._answers: list[tuple[int, bytes]] = []
        self._chip = LocalChip(self._ask)
        self.imu_settings = self._chip.imu_settings

    def _ask(self, what: int) -> bytes:
        answer = self._answer(what)
        self._answers.append((what, answer))
        return answer

    def call(self, operation: int, payload: bytes) -> bytes:
        """Pass a call to the core and record it."""
        self._answers = []
        reply = self._chip.call(operation, payload)
        self._recording.calls.append(Call(operation, payload, self._answers, reply))
        return reply

    def close(self) -> None:
        """Free the board's memory."""
        self._chip.close()


def recorded(
    plan: FloorPlan, *, can: bool = False, seed: int = 1, noise: str = "typical"
) -> tuple[Recording, CoreSweeper]:
    """Return a device with the C core, and the recording that grows while it runs."""
    recording = Recording(RobotModel(), can)
    device = CoreSweeper(
        plan,
        recording.model,
        seed=seed,
        noise=noise,
        link=CanLink if can else Link,
        make_chip=partial(RecordingChip, recording=recording),
    )
    return recording, device


def record_run(  # noqa: PLR0913 - properties of a run
    room: str,
    *,
    can: bool = False,
    max_time_s: float,
    seed: int = 1,
    noise: str = "typical",
    faults: Sequence[str] = (),
) -> Recording:
    """Record a cleaning run in a room, with the planner on the host."""
    plan = load_room(room)
    recording, device = recorded(plan, can=can, seed=seed, noise=noise)
    run_virtual(
        plan,
        recording.model,
        "recovery",
        NullSink(),
        seed=seed,
        noise=noise,
        max_time_s=max_time_s,
        faults=[parse_fault(text) for text in faults],
        resume=Resume.AUTO,
        link=device.link,
        device=device,
    )
    return recording


# ---- the firmwares on a recording --------------------------------------------------------------


class Output(NamedTuple):
    """State and bytes of a firmware after a call."""

    view: View
    wrote: bytes


def core_outputs(recording: Recording) -> list[Output]:
    """Give the recording to the C core."""
    answers: list[tuple[int, bytes]] = []

    def answer(what: int) -> bytes:
        asked, content = answers.pop(0)
        assert asked == what, "the core asks for the same readings in the same order"
        return content

    chip = LocalChip(answer)
    outputs = []
    for call in recording.calls:
        answers[:] = call.answers
        reply = chip.call(call.operation, call.payload)
        assert not answers, "the core asks for all that was recorded"
        if call.operation in _BORDER:
            outputs.append(Output(*view_of(reply)))
    chip.close()
    return outputs


class RecordedSensors:
    """The recorded readings as sensors of the Python firmware."""

    def __init__(self) -> None:
        self.unasked: Counter[str] = Counter()
        """Readings that this firmware takes in a call in which the core does not."""
        self._samples = 0
        self._counts = 0, 0
        self._imu = ImuCounts(0, 0, 0, 0, 0, 0, 0)
        self._answers: dict[int, bytes] = {}
        self._now: set[int] = set()

    def take(self, call: Call) -> None:
        """Have the readings of this call."""
        self._now = {what for what, _ in call.answers}
        self._answers.update(call.answers)
        if call.operation == Operation.POLL:
            left, right, fresh, *counts = POLL.unpack(call.payload)[HEAD_VALUES:]
            self._counts, self._imu = (left, right), ImuCounts(*counts)
            self._samples += fresh

    def imu(self) -> ImuCounts:
        return self._imu

    def imu_samples(self) -> int:
        return self._samples

    def encoders(self) -> tuple[int, int]:
        return self._counts

    def ranges(self) -> Ranges:
        front, left, right, age_us = RANGES.unpack(self._answer(Ask.RANGES))
        return Ranges(seen(front, 1e3), seen(left, 1e4), seen(right, 1e4), age_us)

    def bumpers(self) -> Bumpers:
        contacts = self._answer(Ask.CONTACTS)[0]
        return Bumpers(bool(contacts & Contact.BUMPER_LEFT), bool(contacts & Contact.BUMPER_RIGHT))

    def cliff(self) -> bool:
        return bool(self._answer(Ask.CONTACTS)[0] & Contact.CLIFF)

    def power(self) -> PowerReading:
        return PowerReading(*(milli / 1e3 for milli in POWER.unpack(self._answer(Ask.POWER))))

    def _answer(self, what: Ask) -> bytes:
        if what not in self._now:
            self.unasked[what.name.lower()] += 1
        return self._answers.get(what, _NOTHING[what])


_NOTHING = {
    Ask.RANGES: RANGES.pack(NO_RANGE, NO_RANGE, NO_RANGE, 0),
    Ask.CONTACTS: b"\0",
    Ask.POWER: POWER.pack(0, 0, 0, 0),
}
"""Answers before the first one of the recording."""


class _CoreIdentity(Identity):
    """The identity with the core's name: a longer name takes more frames on CAN."""

    def hello(self, catalogue_hash: int, session_id: int, *, keyed: bool) -> Hello:
        """Return the hello."""
        hello = super().hello(catalogue_hash, session_id, keyed=keyed)
        named: Hello = hello._replace(name=f"{hello.name} (C core)")  # type: ignore[attr-defined]  # messages are named tuples
        return named


class Replayed:
    """The Python firmware on a recording."""

    def __init__(self, recording: Recording) -> None:
        self.sensors = RecordedSensors()
        self._recording = recording
        self._flash = Flash()
        self._flash.key = recording.key
        self._duties = (0.0, 0.0)
        self._firmware: Firmware | None = None
        self._due_us = 0
        self._head: tuple[int, ...] = RECEIVE.unpack(bytes(RECEIVE.size))
        """Time and line of the last call."""

    def run(self) -> list[Output]:
        """Give it all calls; return its outputs."""
        outputs = []
        for call in self._recording.calls:
            self.sensors.take(call)
            if call.operation == Operation.RESET:
                self._flash.power_lost()
                if self._firmware is not None and self._firmware.reboot_wanted is (
                    RebootKind.FACTORY_RESET
                ):
                    self._flash.erase()
            elif call.operation in _BORDER:
                outputs.append(self._do(call))
        return outputs

    def _line_health(self) -> LineHealth:
        _, _, send_errors, receive_errors, _, offs = self._head
        return LineHealth(
            can_send_errors=send_errors, can_receive_errors=receive_errors, can_bus_offs=offs
        )

    def _do(self, call: Call) -> Output:
        if call.operation == Operation.BOOT:
            firmware = self._firmware = self._boot(call.payload)
        else:
            assert self._firmware is not None
            firmware = self._firmware
        wrote = b""
        if call.operation != Operation.BOOT:
            self._head = RECEIVE.unpack_from(call.payload)
        if call.operation == Operation.POLL:
            now_us = POLL.unpack(call.payload)[0]
            self._duties = firmware.tick(now_us)
            self._due_us = firmware.next_us(now_us)
        elif call.operation == Operation.RECEIVE:
            now_us, *_ = RECEIVE.unpack_from(call.payload)
            for piece in pieces(call.payload[RECEIVE.size :], can=self._recording.can):
                firmware.receive(piece, now_us)
                wrote += firmware.data_to_send()  # frames that wait leave by their rank
        wrote += firmware.data_to_send()
        return Output(self._view(firmware), wrote)

    def _boot(self, payload: bytes) -> Firmware:
        values = BOOT.unpack(payload)
        uid, boot_id, cause, node, can, troubles, capabilities, crashed, *crash = values
        self._duties, self._due_us = (0.0, 0.0), 0
        firmware = Firmware(
            self._recording.model,
            _CoreIdentity(
                node,
                uid,
                boot_id,
                ResetCause(cause),
                CrashRecord(*crash) if crashed else None,
                crystal_failed=bool(troubles),
                capabilities=Capability(capabilities),
            ),
            self.sensors,
            flash=self._flash,
            link=CanLink if can else Link,
        )
        firmware.telemetry.counters.line_health = self._line_health
        return firmware

    def _view(self, firmware: Firmware) -> View:
        left, right = self._duties
        return View(
            round(left * _DUTY_ONE),
            round(right * _DUTY_ONE),
            firmware.drivers,
            firmware.reboot_wanted is not None,
            int(firmware.fed),
            STATES.index(firmware.state),
            firmware.stop_cause,
            firmware.negotiated,
            firmware.waits,
            int(firmware.saving),
            blocked=False,
            faults=firmware.faults,
            session_id=firmware.session_id,
            waited_us=0,
            due_us=self._due_us,
        )


# ---- comparison --------------------------------------------------------------------------------


@dataclass(slots=True)
class Difference:
    """Differences of one field over a recording."""

    count: int = 0
    largest: float = 0
    first: str = ""
    """Time of the first one and both values: the core's, then the model's."""

    def add(self, core: object, python: object, where: str) -> None:
        self.count += 1
        if isinstance(core, int | float) and isinstance(python, int | float):
            self.largest = max(self.largest, abs(core - python))
        else:
            self.largest = float("inf")
        self.first = self.first or f"{where}: {core!r}, {python!r}"


@dataclass(slots=True)
class Comparison:
    """What both firmwares did with a recording."""

    calls: int = 0
    frames: int = 0
    fields: dict[str, Difference] = field(default_factory=dict)
    """By the field's name, those that differ."""
    unasked: Counter[str] = field(default_factory=Counter)
    exact: bool = True
    """Whether the core gave the recorded outputs once more, byte for byte."""

    def add(self, name: str, core: object, python: object, where: str) -> None:
        self.fields.setdefault(name, Difference()).add(core, python, where)

    @property
    def unexplained(self) -> dict[str, Difference]:
        """Differences beyond the bound of their field."""
        return {name: found for name, found in self.fields.items() if found.largest > _bound(name)}


def _bound(name: str) -> float:
    return BOUNDS[name][0] if name in BOUNDS else 0.0


_VIEW = {"left": "duty", "right": "duty"}
_OWN = frozenset({"fed", "waited_us", "flash_busy", "blocked"})
"""What the virtual board reports of itself: the model has no main loop and another flash."""


def compare_recorded(recording: Recording) -> Comparison:
    """Give a recording to both firmwares and compare state and output after each call."""
    made = Comparison()
    cores = core_outputs(recording)
    border = [call for call in recording.calls if call.operation in _BORDER]
    made.exact = cores == [Output(*view_of(call.reply)) for call in border]
    replayed = Replayed(recording)
    models = replayed.run()
    made.unasked = replayed.sensors.unasked
    link = CanLink if recording.can else Link
    ears = link(Direction.HOST), link(Direction.HOST)
    for call, core, python in zip(border, cores, models, strict=True):
        made.calls += 1
        now_us = 0 if call.operation == Operation.BOOT else RECEIVE.unpack_from(call.payload)[0]
        where = f"{Operation(call.operation).name.lower()} at {now_us} us"
        for name, own, other in zip(View._fields, core.view, python.view, strict=True):
            if own != other and name not in _OWN:
                made.add(_VIEW.get(name, name), own, other, where)
        pair = [
            _heard(ear, out.wrote, now_us) for ear, out in zip(ears, (core, python), strict=True)
        ]
        made.frames += len(pair[0])
        _compare_frames(made, pair[0], pair[1], where)
    return made


def _heard(ear: LinkBase, wrote: bytes, now_us: int) -> list[Received]:
    events = ear.receive(wrote, now_us)
    assert all(isinstance(event, Received) for event in events), events
    return [event for event in events if isinstance(event, Received)]


def _compare_frames(
    made: Comparison, core: list[Received], python: list[Received], where: str
) -> None:
    names = [[event.spec.name for event in events] for events in (core, python)]
    if names[0] != names[1]:
        made.add("frames", names[0], names[1], where)
        return
    for own, other in zip(core, python, strict=True):
        name = own.spec.name
        if isinstance(own.message, TimeReply):
            late_us = own.frame.t_us - other.frame.t_us
            if late_us:
                made.add("time_reply.sent", own.frame.t_us, other.frame.t_us, where)
        elif own.frame.t_us != other.frame.t_us:
            made.add(f"{name}.t_us", own.frame.t_us, other.frame.t_us, where)
        if own.frame.seq != other.frame.seq:
            made.add(f"{name}.seq", own.frame.seq, other.frame.seq, where)
        if own.message == other.message:
            continue
        for declared, mine, yours in zip(own.spec.fields, own.message, other.message, strict=True):
            if mine != yours:
                made.add(f"{name}.{declared.name}", mine, yours, where)


def lines(made: Comparison) -> Iterable[str]:
    """Return the comparison as text."""
    yield f"{made.calls} calls, {made.frames} frames; the core repeats its run: {made.exact}"
    for what, count in sorted(made.unasked.items()):
        yield f"{what}: {count} readings that only the model in Python takes"
    for name, found in sorted(made.fields.items()):
        bound, cause = BOUNDS.get(name, (0, "no difference is expected"))
        verdict = "within" if found.largest <= bound else "BEYOND"
        yield (
            f"{name}: {found.count} differences, at most {found.largest:g}, {verdict} the bound "
            f"{bound} ({cause}); first {found.first}"
        )
