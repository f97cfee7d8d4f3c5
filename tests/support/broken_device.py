"""Emulated devices with one defect each, which the conformance suite must find.

    python -m support.broken_device DEFECT…

This command prints a line ``ready PORT`` for each device. It serves the devices until its stdin is
closed. Every defect acts on the bytes between a correct device and its port: it changes, holds,
repeats or drops frames.
"""

from __future__ import annotations

import os
import pty
import selectors
import sys
import time
import tty
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from cobs import cobs

from bridge.motion.geometry import Pose2
from protocol.authentication import Authenticator
from protocol.messages.device import Ack, DescribeReply, Hello, LogText, Nack, Status
from protocol.messages.host import (
    ClearStop,
    HostHello,
    SaveParameters,
    SetMode,
    SetStreamRate,
    Stop,
    StopAll,
    TimeRequest,
    VelocitySetpoint,
)
from protocol.messages.values import Fault, StopCause, by_severity
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION
from protocol.schema.codec import Codec
from protocol.uart.framing import Frame, UartParser, encode_frame
from sim_device.sweeper import VirtualSweeper
from support.sim_body import box
from tools.cli.rooms import load_room

if TYPE_CHECKING:
    from protocol.schema.message import Message

FIRST_ID = 0xB000
KEY = bytes(range(0x20, 0x30))
"""Key of the devices that have one."""


class Sound:
    """A device without a defect: the base class, which changes only the ids of commands.

    A device executes no command whose id is far behind the newest id. A defect may insert its own
    commands between the commands of the host. So this class renumbers all commands in one sequence
    for the device. It gives each answer the id that the host chose.
    """

    plan = load_room("empty")

    def __init__(self, seed: int) -> None:
        self.device = VirtualSweeper(self.plan, seed=seed)
        self.now_us = 0
        self.codec = Codec(CATALOGUE)
        self._up, self._down = UartParser(), UartParser()
        self._newest_id = FIRST_ID
        self._ids: dict[int, int] = {}
        """Ids that the device receives in this session; the keys are the ids that the host chose.
        """
        self._own_ids: set[int] = set()

    def step(self, data: bytes, now_us: int) -> bytes:
        """Step the device and pass its bytes through this object."""
        self.now_us = now_us
        out = self.device.step(self.to_device(data), now_us)
        return self.to_host(out)

    def to_device(self, data: bytes) -> bytes:
        """Return the bytes for the device: those from the host, and the inserted commands."""
        frames = [f for f in self._down.feed(data) if isinstance(f, Frame)]
        going = (self._numbered(g) for f in frames for g in self.host_frame(f))
        return b"".join(map(_bytes, going)) + self.injected()

    def to_host(self, data: bytes) -> bytes:
        """Return the bytes for the host."""
        frames = [self._renumbered(f) for f in self._up.feed(data) if isinstance(f, Frame)]
        return b"".join(_bytes(g) for f in frames for g in self.device_frame(f))

    def _numbered(self, frame: Frame) -> Frame:
        """Return a frame of the host with the command id for the device."""
        message = self.message(frame)
        if isinstance(message, HostHello):
            self._ids.clear()
        number = getattr(message, "command_id", None)
        if number is None or self.is_own(number):
            return frame
        if number not in self._ids:
            self._ids[number] = self._next_id()
        return self.saying(frame, message, command_id=self._ids[number])

    def _renumbered(self, frame: Frame) -> Frame:
        """Return a frame of the device with the command id that the host chose."""
        message = self.message(frame)
        if isinstance(message, Ack | Nack):
            for number, seen in self._ids.items():
                if seen == message.command_id:
                    return self.saying(frame, message, command_id=number)
        return frame

    def host_frame(self, frame: Frame) -> list[Frame]:
        """Return the frames that replace a frame of the host."""
        return [frame]

    def device_frame(self, frame: Frame) -> list[Frame]:
        """Return the frames that replace a frame of the device."""
        return [frame]

    def injected(self) -> bytes:
        """Return additional bytes for the device."""
        return b""

    def message(self, frame: Frame) -> Message:
        return self.codec.decode(CATALOGUE.by_type[frame.type_id], frame.payload)

    def saying(self, frame: Frame, message: Message, **changes: int) -> Frame:
        """Return a frame with other content."""
        names = (field.name for field in CATALOGUE.by_class[type(message)].fields)
        values = dict(zip(names, message, strict=True)) | changes
        type_id, payload = self.codec.encode(type(message)(**values))
        return frame._replace(type_id=type_id, payload=payload)

    def own_id(self) -> int:
        """Return an id for an inserted command; the host must not receive its answer."""
        number = self._next_id()
        self._own_ids.add(number)
        return number

    def is_own(self, number: int) -> bool:
        return number in self._own_ids

    def _next_id(self) -> int:
        self._newest_id = (self._newest_id + 1) & 0xFFFF
        return self._newest_id


class WrongChain(Sound):
    """Sends wrong chain hashes after the second field."""

    def device_frame(self, frame: Frame) -> list[Frame]:
        message = self.message(frame)
        if isinstance(message, DescribeReply) and message.described_type == 0x13:
            return [self.saying(frame, message, chain=message.chain ^ 1)]
        return [frame]


class RareHello(Sound):
    """Sends a hello only every other second."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._hellos = 0

    def device_frame(self, frame: Frame) -> list[Frame]:
        message = self.message(frame)
        if isinstance(message, Hello) and message.session_id == 0:
            self._hellos += 1
            return [frame] if self._hellos % 2 else []
        return [frame]


class ExecutesRepeats(Sound):
    """Executes every repetition of a command."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._reported: dict[int, int] = {}

    def host_frame(self, frame: Frame) -> list[Frame]:
        message = self.message(frame)
        if isinstance(message, ClearStop):
            own = self.own_id()
            self._reported[own] = message.command_id
            return [self.saying(frame, message, command_id=own)]
        return [frame]

    def device_frame(self, frame: Frame) -> list[Frame]:
        message = self.message(frame)
        if isinstance(message, Ack | Nack) and message.command_id in self._reported:
            return [self.saying(frame, message, command_id=self._reported[message.command_id])]
        return [frame]


class DropsLatch(Sound):
    """Acknowledges a stop and stops, but drops the latch shortly afterwards."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._cause = 0
        self._latched_us = 0
        self._own: set[int] = set()

    def device_frame(self, frame: Frame) -> list[Frame]:
        message = self.message(frame)
        if isinstance(message, Status) and message.stop_cause != self._cause:
            self._cause, self._latched_us = message.stop_cause, self.now_us
        if isinstance(message, Ack | Nack) and message.command_id in self._own:
            return []
        return [frame]

    def injected(self) -> bytes:
        if self._cause in {0, StopCause.SESSION_END, StopCause.LINK}:
            return b""
        if self.now_us - self._latched_us < 20_000:
            return b""
        self._latched_us = self.now_us
        own = self.own_id()
        self._own = {own}
        type_id, payload = self.codec.encode(ClearStop(own, self._cause))
        return _bytes(Frame(PROTOCOL_VERSION << 4, 1, type_id, 0, 0, payload))


class StampsLate(Sound):
    """Stamps frames when they leave, every 25 ms, not when their content was sampled."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._held: list[Frame] = []
        self._left_us = 0

    def to_host(self, data: bytes) -> bytes:
        super().to_host(data)
        if self.now_us - self._left_us < 25_000:
            return b""
        self._left_us = self.now_us
        out = b"".join(_bytes(f._replace(t_us=self.now_us)) for f in self._held)
        self._held.clear()
        return out

    def device_frame(self, frame: Frame) -> list[Frame]:
        self._held.append(frame)
        return []


class Lossy(Sound):
    """Loses one of its own frames now and then."""

    def device_frame(self, frame: Frame) -> list[Frame]:
        return [] if frame.seq % 64 == 17 else [frame]


class DrivesOn(Sound):
    """Drives on for seconds after the last setpoint."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._last: tuple[int, Frame, VelocitySetpoint] | None = None
        self._reply_us = 0
        self._counter = 0

    def host_frame(self, frame: Frame) -> list[Frame]:
        message = self.message(frame)
        if isinstance(message, VelocitySetpoint):
            self._last = (self.now_us, frame, message)
            return []
        return [frame]

    def injected(self) -> bytes:
        if self._last is None or self.now_us - self._reply_us < 20_000:
            return b""
        received_us, frame, message = self._last
        if self.now_us - received_us > 2_500_000:
            return b""
        self._reply_us = self.now_us
        self._counter = (self._counter + 1) & 0xFF
        stamp_us = (frame.t_us + self.now_us - received_us) & 0xFFFF_FFFF
        again = self.saying(frame, message, counter=self._counter)
        return _bytes(again._replace(t_us=stamp_us))


class IgnoresCrc(Sound):
    """Never checks a frame's CRC."""

    def to_device(self, data: bytes) -> bytes:
        out = b""
        for piece in data.split(b"\0"):
            with suppress(cobs.DecodeError, ValueError, KeyError):
                body = cobs.decode(piece)
                if len(body) >= 12:
                    flags, node, type_id, seq = body[:4]
                    t_us = int.from_bytes(body[4:8], "little")
                    out += _bytes(Frame(flags, node % 16, type_id, seq, t_us, body[8:-4]))
        return out


class TransmitOnly(Sound):
    """Does not react to a silent host."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._reply_us = 0

    def injected(self) -> bytes:
        if self.now_us - self._reply_us < 300_000:
            return b""
        self._reply_us = self.now_us
        type_id, payload = self.codec.encode(TimeRequest(0))
        return _bytes(Frame(PROTOCOL_VERSION << 4, 1, type_id, 0, self.now_us, payload))


class ObeysOtherNodes(Sound):
    """Accepts messages that are addressed to other devices."""

    def host_frame(self, frame: Frame) -> list[Frame]:
        return [frame._replace(node=1)]


class ObeysNodeAll(Sound):
    """Obeys every message that is addressed to all."""

    def host_frame(self, frame: Frame) -> list[Frame]:
        return [frame if frame.node else frame._replace(node=1)]


class LatchesNewest(Sound):
    """Latches the cause of the last stop, even if the one before was graver."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._own: set[int] = set()

    def host_frame(self, frame: Frame) -> list[Frame]:
        if not isinstance(self.message(frame), Stop):
            return [frame]
        clears = [ClearStop(self.own_id(), cause) for cause in by_severity()]
        self._own |= {clear.command_id for clear in clears}
        return [*(self.saying(frame, c, command_id=c.command_id) for c in clears), frame]

    def device_frame(self, frame: Frame) -> list[Frame]:
        message = self.message(frame)
        mine = isinstance(message, Ack | Nack) and message.command_id in self._own
        return [] if mine else [frame]


class SavesNothing(Sound):
    """Reports that parameters were saved, but saves none."""

    def host_frame(self, frame: Frame) -> list[Frame]:
        message = self.message(frame)
        if isinstance(message, SaveParameters):
            return [self.saying(frame, Stop(message.command_id, StopCause.SESSION_END))]
        return [frame]

    def device_frame(self, frame: Frame) -> list[Frame]:
        message = self.message(frame)
        if isinstance(message, Ack) and message.command_type == 0x01:
            return [self.saying(frame, message, command_type=t) for t in (0x01, 0x72)]
        return [frame]


class IgnoresStopAll(Sound):
    """Obeys only its owner's stop."""

    def host_frame(self, frame: Frame) -> list[Frame]:
        return [] if isinstance(self.message(frame), StopAll) else [frame]


class IgnoresBootId(Sound):
    """Opens a session for a host that names another boot."""

    def host_frame(self, frame: Frame) -> list[Frame]:
        message = self.message(frame)
        if isinstance(message, HostHello):
            return [self.saying(frame, message, boot_id=self.device.firmware.identity.boot_id)]
        return [frame]


class AtCliff(Sound):
    """A sound device with no floor under its cliff sensor."""

    plan = replace(
        load_room("empty"), start=Pose2(1.5, 1.25, 0.0), cliffs=(box(1.64, 0.0, 3.0, 2.5),)
    )


class Pressed(Sound):
    """A sound device with a bumper held pressed."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self.device.sensors.faults.bumper_stuck_left = True


class Crashed(Sound):
    """A sound device whose processor has faulted before."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self.device.crash()


class KeepsDriversOn(Sound):
    """Never disables its motor drivers."""

    def device_frame(self, frame: Frame) -> list[Frame]:
        message = self.message(frame)
        if isinstance(message, Status):
            return [self.saying(frame, message, faults=message.faults & ~int(Fault.DRIVERS_OFF))]
        return [frame]


class FalseReversal(Sound):
    """Mistakes a wheel that turns back for one with a reversed encoder."""

    def device_frame(self, frame: Frame) -> list[Frame]:
        message = self.message(frame)
        if isinstance(message, Status) and self.device.truth.left_rad_s < 0.0:
            reversed_left = message.faults | int(Fault.ENCODER_LEFT_REVERSED)
            return [self.saying(frame, message, faults=reversed_left)]
        return [frame]


class IgnoresCliff(AtCliff):
    """Drives over a cliff."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self.device.firmware.control.reflexes.at_cliff = False


class IgnoresBumper(Pressed):
    """Pushes on with a bumper pressed."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self.device.firmware.control.reflexes.at_bumper = False


class AcksSaveEarly(Sound):
    """Acknowledges a save before it has begun."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._answers = b""

    def host_frame(self, frame: Frame) -> list[Frame]:
        message = self.message(frame)
        if isinstance(message, SaveParameters):
            ack = self.codec.encode(Ack(message.command_id, frame.type_id))
            self._answers += _bytes(Frame(PROTOCOL_VERSION << 4, 1, ack[0], 0, self.now_us, ack[1]))
        return [frame]

    def to_host(self, data: bytes) -> bytes:
        answers, self._answers = self._answers, b""
        return answers + super().to_host(data)


class ImpreciseClock(Sound):
    """Runs from an oscillator that is off by 0.9 %, and does not report it."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self.device.clock.drift_ppm = 9_000.0


class HidesCrash(Crashed):
    """Has crashed, but does not report where."""

    def device_frame(self, frame: Frame) -> list[Frame]:
        message = self.message(frame)
        crash = isinstance(message, LogText) and message.line.startswith("crash")
        return [] if crash else [frame]


class Keyed(Sound):
    """A sound device with a key. Its bytes are not changed, so that their tags stay valid."""

    authenticator: type[Authenticator] = Authenticator

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self.device.flash.key = KEY
        self.device.firmware.keyring.take()
        self.device.firmware.link.key = self.authenticator(KEY)

    def to_device(self, data: bytes) -> bytes:
        return data

    def to_host(self, data: bytes) -> bytes:
        return data


class ObeysUnsignedCommands(Keyed):
    """Obeys commands without a tag."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        keyring = self.device.firmware.keyring
        must_reject, command_types = keyring.must_reject, {SetMode, SetStreamRate}
        kinds = {CATALOGUE.by_class[kind].type_id for kind in command_types}
        keyring.must_reject = lambda frame: frame.type_id not in kinds and must_reject(frame)  # type: ignore[method-assign]  # the defect


class ObeysUnsignedSetpoints(Keyed):
    """Obeys setpoints without a tag."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        keyring = self.device.firmware.keyring
        must_reject, setpoint = keyring.must_reject, CATALOGUE.by_class[VelocitySetpoint].type_id
        keyring.must_reject = lambda frame: frame.type_id != setpoint and must_reject(frame)  # type: ignore[method-assign]  # the defect


class AnyTag(Authenticator):
    """Accepts every tag with a new counter."""

    _highest = -1

    def begin(self, boot_id: int, session_id: int, challenge: int) -> None:
        super().begin(boot_id, session_id, challenge)
        self._highest = challenge

    def check(self, covered: bytes, trailer: bytes) -> bool:
        counter = int.from_bytes(trailer[:4], "little")
        new = 0 < (counter - self._highest) % 2**32 < 2**31
        self._highest = counter if new else self._highest
        return new or super().check(covered, trailer)


class Remembering(Authenticator):
    """Accepts every signed frame that it has accepted before, in this session or an earlier one."""

    def __init__(self, key: bytes) -> None:
        super().__init__(key)
        self._accepted: set[tuple[bytes, bytes]] = set()
        self._earlier: set[tuple[bytes, bytes]] = set()

    def end(self) -> None:
        super().end()
        self._earlier |= self._accepted
        self._accepted.clear()

    def begin(self, boot_id: int, session_id: int, challenge: int) -> None:
        self._earlier |= self._accepted
        self._accepted.clear()
        super().begin(boot_id, session_id, challenge)

    def check(self, covered: bytes, trailer: bytes) -> bool:
        frame = (covered, trailer)
        if super().check(covered, trailer):
            self._accepted.add(frame)
            return True
        return frame in self.again()

    def again(self) -> set[tuple[bytes, bytes]]:
        """Return the frames that are accepted although they are not new."""
        return self._accepted


class RememberingSessions(Remembering):
    """Accepts frames of earlier sessions again."""

    def again(self) -> set[tuple[bytes, bytes]]:
        return self._earlier


class IgnoresTags(Keyed):
    """Compares the counter of a signed frame, but not its tag."""

    authenticator = AnyTag


class ObeysReplays(Keyed):
    """Obeys a signed frame again within its session."""

    authenticator = Remembering


class ObeysEarlierSessions(Keyed):
    """Obeys signed frames of earlier sessions."""

    authenticator = RememberingSessions


class WeakensUnsignedStop(Keyed):
    """Treats an unsigned stop as the end of the session, which any host may clear."""

    def to_device(self, data: bytes) -> bytes:
        frames = [f for f in self._down.feed(data) if isinstance(f, Frame)]
        return b"".join(_bytes(self._weakened(f)) for f in frames)

    def _weakened(self, frame: Frame) -> Frame:
        if frame.flags or frame.type_id != CATALOGUE.by_class[Stop].type_id:
            return frame
        return self.saying(frame, self.message(frame), cause=StopCause.SESSION_END)


STATES = ("atcliff", "pressed", "crashed", "keyed")
"""Sound devices in a state that a check needs."""
DEFECTS = {
    kind.__name__.lower(): kind
    for kind in (
        Sound,
        WrongChain,
        RareHello,
        ExecutesRepeats,
        DropsLatch,
        StampsLate,
        Lossy,
        DrivesOn,
        IgnoresCrc,
        TransmitOnly,
        ObeysOtherNodes,
        ObeysNodeAll,
        LatchesNewest,
        SavesNothing,
        IgnoresStopAll,
        IgnoresBootId,
        AtCliff,
        Pressed,
        Crashed,
        KeepsDriversOn,
        FalseReversal,
        IgnoresCliff,
        IgnoresBumper,
        AcksSaveEarly,
        ImpreciseClock,
        HidesCrash,
        Keyed,
        ObeysUnsignedCommands,
        ObeysUnsignedSetpoints,
        IgnoresTags,
        ObeysReplays,
        ObeysEarlierSessions,
        WeakensUnsignedStop,
    )
}


def _bytes(frame: Frame) -> bytes:
    return b"\0" + encode_frame(
        frame.node, frame.type_id, frame.seq, frame.t_us, frame.payload, frame.flags
    )


def serve(names: list[str]) -> None:
    """Run devices on a pseudo-terminal each, in real time, until stdin is closed."""
    devices: dict[int, Sound] = {}
    with selectors.DefaultSelector() as selector:
        selector.register(sys.stdin, selectors.EVENT_READ)
        for seed, name in enumerate(names):
            master, slave = pty.openpty()
            tty.setraw(slave)
            os.set_blocking(master, False)
            devices[master] = DEFECTS[name](seed)
            selector.register(master, selectors.EVENT_READ)
            sys.stdout.write(f"ready {os.ttyname(slave)}\n")
        sys.stdout.flush()
        boots_ns: dict[int, int] = {}
        while True:
            awake = [
                d.device.next_deadline_us() + boots_ns[m] // 1000
                for m, d in devices.items()
                if m in boots_ns
            ]
            now_us = time.monotonic_ns() // 1000
            wait_s = max(0, min(awake) - now_us) / 1e6 if awake else None
            ready = {key.fd for key, _ in selector.select(wait_s)}
            if sys.stdin.fileno() in ready:
                return
            for master, device in devices.items():
                data = os.read(master, 4096) if master in ready else b""
                if data:  # switched on by the first byte: an unused device costs nothing
                    boots_ns.setdefault(master, time.monotonic_ns())
                if master not in boots_ns:
                    continue
                out = device.step(data, (time.monotonic_ns() - boots_ns[master]) // 1000)
                with suppress(BlockingIOError):
                    os.write(master, out)


if __name__ == "__main__":
    serve(sys.argv[1:])
