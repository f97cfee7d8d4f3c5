"""The plant of an emulated chip; a scripted chip replaces QEMU."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from protocol.messages.values import ResetCause
from sim_device.ports import qemu_link as link
from sim_device.ports import qemu_sweeper
from sim_device.ports.qemu_process import QemuGoneError
from tools.cli.rooms import load_room

if TYPE_CHECKING:
    from collections.abc import Iterator

TURN_US = 10_000
WRAP = 1 << 32


class FakeLane:
    def __init__(self) -> None:
        self.printed, self.received = b"", b""

    def read(self) -> bytes:
        printed, self.printed = self.printed, b""
        return printed

    def write(self, data: bytes) -> None:
        self.received += data


class FakeQemu:
    """A chip that sends the messages of the test."""

    def __init__(self, firmware: Path) -> None:
        del firmware
        self.wire, self.plant = FakeLane(), FakeLane()
        self.orders: list[str] = []
        self.closed = False
        self.plant.printed = link.frame(link.FromChip.BOOT, bytes([self.version]))

    version = link.VERSION

    def check(self) -> None:
        """Do nothing: this process never ends by itself."""

    def reset(self) -> None:
        self.orders.append("reset")

    def halt(self) -> None:
        self.orders.append("halt")

    def resume(self) -> None:
        self.orders.append("go on")

    def close(self) -> None:
        self.closed = True


class Chip:
    """A sweeper and the chip's end of its link."""

    def __init__(self) -> None:
        self.sweeper = qemu_sweeper.QemuSweeper(
            Path("firmware.elf"), load_room("empty"), seed=1, noise="none", node=7, boot_id=99
        )
        self.qemu: FakeQemu = self.sweeper.qemu  # type: ignore[assignment]
        self.newest_us = 0

    def step(self, now_us: int, *frames: bytes, wire: bytes = b"") -> bytes:
        self.qemu.plant.printed += b"".join(frames)
        return self.sweeper.step(wire, now_us)

    def request(self, chip_us: int, sample_us: int, left: int = 0, right: int = 0) -> bytes:
        numbers = (chip_us % WRAP, sample_us % WRAP, self.newest_us % WRAP, left, right, 7000, 1)
        return link.frame(link.FromChip.REQUEST, struct.pack("<IIIhhH?", *numbers))

    def received(self) -> list[tuple[int, bytes]]:
        """Return type and payload of the plant's messages since the last call."""
        data, self.qemu.plant.received = self.qemu.plant.received, b""
        frames = []
        while data:
            end = 3 + data[2]
            frames.append((data[1], data[3:end]))
            data = data[end + 4 :]
        return frames

    def boot(self, now_us: int = 0) -> None:
        self.step(now_us)
        assert [kind for kind, _ in self.received()][-1] == link.ToChip.IDENTITY


@pytest.fixture
def chip(monkeypatch: pytest.MonkeyPatch) -> Iterator[Chip]:
    monkeypatch.setattr(qemu_sweeper, "QemuProcess", FakeQemu)
    made = Chip()
    yield made
    made.sweeper.close()
    assert made.qemu.closed


def stamps(frames: list[tuple[int, bytes]]) -> list[int]:
    return [
        int.from_bytes(payload[:4], "little")
        for kind, payload in frames
        if kind == link.ToChip.SAMPLE
    ]


def test_a_chip_is_given_its_identity(chip: Chip) -> None:
    chip.step(0)
    ((kind, payload),) = chip.received()
    assert kind == link.ToChip.IDENTITY
    uid, boot_id, cause, node, chunks = struct.unpack("<12sIBBB", payload)
    assert (boot_id, cause, node, chunks) == (99, ResetCause.POWER_ON, 7, 0)
    assert len(set(uid)) > 3


def test_readings_are_of_the_moment_that_was_asked_for(chip: Chip) -> None:
    chip.boot()
    chip.step(5_000, chip.request(302_000, 310_000))
    assert stamps(chip.received()) == [310_000]
    assert chip.sweeper.plant.tick_ms == 13, "8 ms after the request, which was sent at 5 ms"
    chip.newest_us = 310_000
    chip.step(15_000, chip.request(312_000, 320_000, 5000, 5000))
    assert stamps(chip.received()) == [320_000]
    assert chip.sweeper.plant.tick_ms == 23
    assert chip.sweeper.truth.left_rad > 0.0
    assert chip.sweeper.truth.right_rad > 0.0
    assert chip.sweeper.stack_free == 7000


def test_late_requests_do_not_queue_up(chip: Chip) -> None:
    """The plant answers the newest request, once the chip has received the last readings."""
    chip.boot()
    chip.step(2_000, chip.request(2_000, 10_000))
    assert stamps(chip.received()) == [10_000]
    chip.step(12_000, chip.request(12_000, 20_000))
    assert stamps(chip.received()) == [], "the chip has not confirmed the readings of 10 ms"
    chip.newest_us = 10_000
    chip.step(42_000, *(chip.request(at, at + 8_000) for at in (22_000, 32_000, 42_000)))
    assert stamps(chip.received()) == [50_000]
    chip.step(280_000, chip.request(280_000, 288_000))
    assert stamps(chip.received()) == [288_000], "unconfirmed readings count as lost after a while"


def test_the_plant_continues_over_a_wrap_of_the_chips_clock(chip: Chip) -> None:
    chip.boot()
    start_us = WRAP - 25_000
    chip.newest_us = 0
    for turn in range(6):
        chip.step(
            TURN_US * turn, chip.request(start_us + TURN_US * turn, start_us + TURN_US * turn)
        )
        chip.newest_us = (stamps(chip.received()) or [chip.newest_us])[-1]
        assert chip.sweeper.plant.tick_ms == 10 * turn
    assert chip.newest_us == 25_000


def test_the_body_rolls_on_while_the_chip_is_silent(chip: Chip) -> None:
    chip.boot()
    chip.step(2_000, chip.request(2_000, 10_000, 6000, 6000))
    for now_us in range(10_000, 500_001, TURN_US):
        chip.step(now_us)
    assert chip.sweeper.plant.tick_ms == 500
    rolled_m = chip.sweeper.truth.path_m
    assert rolled_m > 0.03
    chip.step(510_000, chip.request(100_000, 108_000))  # the chip's clock stood still meanwhile
    assert chip.sweeper.plant.tick_ms >= 500, "the plant's time never goes back"
    chip.step(520_000, chip.request(110_000, 118_000))
    assert chip.sweeper.plant.tick_ms == pytest.approx(518, abs=12)


def test_duties_hold_from_the_moment_they_are_set(chip: Chip) -> None:
    chip.boot()
    chip.step(2_000, chip.request(2_000, 10_000))
    motors = link.frame(link.FromChip.MOTORS, struct.pack("<Ihh?", 110_000, 10_000, -10_000, 1))
    chip.step(210_000, motors, chip.request(202_000, 210_000, 10_000, -10_000))
    truth = chip.sweeper.truth
    assert truth.tick_ms == 210
    assert truth.left_rad > 0.0 > truth.right_rad
    turned = truth.left_rad
    chip.step(310_000, chip.request(302_000, 310_000, 10_000, -10_000))
    assert chip.sweeper.truth.left_rad - turned > turned, (
        "100 ms at speed is further than 100 ms from rest"
    )


def test_flash_outlives_a_reset_and_the_link_sends_its_last_bytes(chip: Chip) -> None:
    chip.boot()
    content = bytes(range(200))
    chip.step(
        1_000,
        link.frame(link.FromChip.ERASE, b"\x01"),
        link.frame(link.FromChip.WRITE, struct.pack("<BH", 1, 0) + content[:128]),
        link.frame(link.FromChip.WRITE, struct.pack("<BH", 1, 128) + content[128:]),
    )
    chip.step(2_000, chip.request(2_000, 10_000, 6000, 6000))
    chip.received()
    chip.qemu.wire.printed = b"an answer"
    reset = link.frame(link.FromChip.RESET, bytes([ResetCause.SOFTWARE]))
    assert chip.step(3_000, reset) == b"an answer"
    chip.qemu.wire.printed = b"noise of a reset"
    assert chip.step(4_000) == b""
    assert chip.sweeper.plant.motor_voltages_v == (0.0, 0.0)
    chip.step(5_000, link.frame(link.FromChip.BOOT, bytes([link.VERSION])))
    *pages, (kind, identity) = chip.received()
    assert [(k, p[:3]) for k, p in pages] == [
        (link.ToChip.PAGE, struct.pack("<BH", 1, 0)),
        (link.ToChip.PAGE, struct.pack("<BH", 1, 128)),
    ]
    assert b"".join(p[3:] for _, p in pages) == content
    assert kind == link.ToChip.IDENTITY
    _, boot_id, cause, _, chunks = struct.unpack("<12sIBBB", identity)
    assert (cause, chunks) == (ResetCause.SOFTWARE, 2)
    assert boot_id not in {0, 99}


def test_a_brown_out_and_the_supply_that_comes_back(chip: Chip) -> None:
    chip.boot()
    chip.step(2_000, chip.request(2_000, 10_000, 6000, 6000))
    chip.sweeper.plant.set_charge(0.0)
    for now_us in range(10_000, 300_001, TURN_US):
        chip.step(now_us)
    assert chip.qemu.orders == ["halt"]
    chip.sweeper.plant.set_charge(1.0)
    for now_us in range(310_000, 400_001, TURN_US):
        chip.step(now_us)
    assert chip.qemu.orders == ["halt", "reset", "go on"]
    chip.step(410_000, link.frame(link.FromChip.BOOT, bytes([link.VERSION])))
    _, identity = chip.received()[-1]
    assert identity[16] == ResetCause.BROWN_OUT


def test_a_chip_that_is_dead_is_reset(chip: Chip) -> None:
    chip.boot()
    chip.step(2_000, chip.request(2_000, 10_000, 6000, 6000))
    for now_us in range(10_000, 1_990_001, TURN_US):
        chip.step(now_us)
    assert chip.qemu.orders == []
    for now_us in range(2_000_000, 2_050_001, TURN_US):
        chip.step(now_us)
    assert chip.qemu.orders == ["reset"]
    assert chip.sweeper.plant.motor_voltages_v == (0.0, 0.0)


def test_another_version_of_the_link(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(qemu_sweeper, "QemuProcess", FakeQemu)
    monkeypatch.setattr(FakeQemu, "version", link.VERSION + 1)
    with pytest.raises(QemuGoneError, match=r"firmware\.elf does not run: it speaks version 4"):
        Chip()
