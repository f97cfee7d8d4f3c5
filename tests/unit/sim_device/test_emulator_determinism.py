"""Equal seeds give equal bytes, for any process, hash seed or step length."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from protocol.messages.host import ClearStop, HostHello, SetMode, TimeRequest, VelocitySetpoint
from protocol.messages.values import Mode, StopCause
from protocol.schema.message import Direction
from protocol.uart.link import Link
from sim_device.faults.kinds import parse_fault
from sim_device.line.line import LineSettings
from sim_device.rig import Rig
from sim_device.sweeper import VirtualSweeper
from support.root import ROOT
from tools.cli.rooms import load_room

FAULTS = ("bit-flips@1.0:0.6:0.002", "wheel-slip@1.2:0.8:side=left", "jitter@1.4:0.5")
LASTS_US = 3_000_000
HOST_BOOT_US = 7_000_000
MIXED_US = (1, 999, 20_000, 7, 13_337)


def host_words(boot_id: int) -> list[tuple[int, bytes]]:
    """Return times and bytes of a host: handshake, enabling, and setpoints until 3 s."""
    link = Link(Direction.HOST)
    printed: list[tuple[int, bytes]] = []

    def inform(at_us: int, message: object) -> None:
        link.send(message, at_us + HOST_BOOT_US, node=1)  # type: ignore[arg-type]  # a message
        printed.append((at_us, link.data_to_send()))

    inform(350_000, HostHello(link.codec.catalogue.hash, 77, boot_id, 1, "determinism"))
    inform(400_000, ClearStop(1, StopCause.SESSION_END))
    inform(420_000, SetMode(2, Mode.VELOCITY))
    for number, at_us in enumerate(range(450_000, LASTS_US, 20_000)):
        inform(
            at_us, VelocitySetpoint(1500, 2000 if number % 40 < 20 else -2500, 200, number % 256)
        )
        if number % 10 == 0:
            inform(at_us, TimeRequest(number % 256))
    return printed


def device_bytes(seed: int, *, faults: bool, steps_us: tuple[int, ...] = ()) -> bytes:
    """Return all bytes of the device; ``steps_us`` adds steps without work."""
    device = VirtualSweeper(load_room("case-1"), seed=seed, noise="harsh")
    specs = [parse_fault(text) for text in FAULTS] if faults else []
    rig = Rig(device, LineSettings(), specs, seed=seed)
    words = host_words(device.firmware.identity.boot_id)
    out = b""
    now_us = turn = 0
    while now_us < LASTS_US:
        moments = [rig.next_deadline_us(), LASTS_US]
        if words:
            moments.append(words[0][0])
        if steps_us:
            moments.append(now_us + steps_us[turn % len(steps_us)])
            turn += 1
        now_us = max(now_us, min(moments))
        received = b""
        while words and words[0][0] <= now_us:
            received += words.pop(0)[1]
        out += rig.step(received, now_us)
    return out


@cache
def here(seed: int, *, faults: bool) -> bytes:
    return device_bytes(seed, faults=faults)


@cache
def elsewhere(hash_seed: str) -> tuple[str, str]:
    """Return the digests of seed 11 without and with faults, from another process."""
    program = (
        "import hashlib, runpy\n"
        f"found = runpy.run_path({str(Path(__file__))!r})['device_bytes']\n"
        "for faults in (False, True):\n"
        "    print(hashlib.sha256(found(11, faults=faults)).hexdigest())\n"
    )
    paths = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": paths, "PYTHONHASHSEED": hash_seed},
        capture_output=True,
        text=True,
        check=True,
    )
    without, with_faults = done.stdout.split()
    return without, with_faults


@pytest.mark.parametrize("hash_seed", ["0", "1234"])
def test_another_process_gives_the_same(hash_seed: str) -> None:
    without, with_faults = elsewhere(hash_seed)
    assert without == hashlib.sha256(here(11, faults=False)).hexdigest()
    assert with_faults == hashlib.sha256(here(11, faults=True)).hexdigest()


def test_the_runs_are_worth_comparing() -> None:
    """The robot drives and sends all kinds of messages, and the faults have an effect."""
    received = here(11, faults=False)
    assert len(received) > 10_000
    kinds = {event.spec.name for event in Link(Direction.HOST).receive(received, 0)}  # type: ignore[union-attr]  # all frames are intact
    assert {"imu", "encoders", "range", "power", "status", "time_reply", "ack"} <= kinds
    assert here(11, faults=True) != received


@pytest.mark.parametrize("faults", [False, True])
def test_another_seed_gives_another_result(*, faults: bool) -> None:
    assert here(12, faults=faults) != here(11, faults=faults)


def test_the_step_length_changes_nothing() -> None:
    """Steps at arbitrary times, as in real time, give the same bytes as steps at deadlines."""
    assert device_bytes(11, faults=True, steps_us=MIXED_US) == here(11, faults=True)
