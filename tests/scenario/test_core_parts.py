"""Parts of the C firmware without a counterpart in Python, and hostile scripts."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from protocol.generate import render
from protocol.messages.device import INFRARED_NONE, ULTRASONIC_NONE, Range
from protocol.messages.host import Stop, VelocitySetpoint
from protocol.messages.values import Fault, StopCause
from protocol.schema.message import Direction
from protocol.uart.link import Link
from support.c_build import C_TESTS, MORE, STRICT, any_compiler, locked, run, tool
from support.core_build import CORE, FIRMWARE, compile_core, script_board, wire
from support.desk_device import check_that_connect_accepts
from support.random_scripts import Writer
from support.script_format import Boot, Readings, Step, received, script

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

PARTS = (
    "authentication.c",
    "flash_store.c",
    "held.c",
    "inbox.c",
    "line.c",
    "parameters.c",
    "sha256.c",
    "text.c",
)


def test_interrupt_rings_and_the_line_s_queue(tmp_path: Path) -> None:
    folder = wire(tmp_path)
    sources = [FIRMWARE / "core" / name for name in PARTS]
    includes = (f"-I{FIRMWARE / 'include'}", f"-I{FIRMWARE / 'core'}", f"-I{folder}")
    program = tmp_path / "parts"
    compiler = any_compiler("gcc", "clang")
    files = (*sources, C_TESTS / "core_parts.c", folder / "sweepctl_protocol.c")
    flags = (*STRICT, *MORE, "-Wno-unused-parameter", "-g", *compiler.sanitized)
    compiler.run(*flags, *includes, "-o", program, *files)
    run([program])


@pytest.mark.parametrize("seed", range(12))
def test_no_script_breaks_it(seed: int) -> None:
    """Scripts are sessions with changed, removed and duplicated bytes.

    The sanitizers must not report an error.
    """
    rng = random.Random(seed)
    writer = Writer(can=seed % 3 == 0)
    writer.begin()
    writer.drive(2000, 300, 20)
    data = bytearray(script(writer.acts) * 3)
    for _ in range(60):
        at = rng.randrange(len(data))
        match rng.randrange(3):
            case 0:
                data[at] = rng.randrange(256)
            case 1:
                del data[at : at + rng.randrange(9)]
            case _:
                data[at:at] = data[at : at + rng.randrange(40)]
    script_board().raw(_short_steps(bytes(data)))


def _short_steps(data: bytes) -> bytes:
    """Limit each step of a changed script to 0.25 s, because a changed time may be an hour."""
    short = bytearray(data)
    for at in range(len(short) - 5):
        if short[at] == ord("S"):
            short[at + 3] &= 3
            short[at + 4] = 0
    return bytes(short)


@pytest.mark.parametrize("connected", [True, False])
def test_inputs_of_parts_that_are_not_connected_have_no_effect(
    connected: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    writer = Writer()
    writer.acts = [
        Readings(ultrasonic_mm=50, infrared_dmm=(400, 500), contacts=7),
        Boot(only_wheels_and_imu=not connected),
    ]
    writer.begin()
    writer.drive(200, 0, 20)
    reports = script_board().run(writer.acts)
    stands = reports[-1].motors == (0, 0)
    assert stands == connected, "a pressed bumper and a missing floor stop the robot"
    sent = [event.message for event in received(reports, Link(Direction.HOST))]
    last = [message for message in sent if isinstance(message, Range)][-1]
    values = last.ultrasonic, last.infrared_left, last.infrared_right, int(last.contacts)
    none = (ULTRASONIC_NONE, INFRARED_NONE, INFRARED_NONE, 0)
    assert values == ((50, 32, 40, 7) if connected else none), "40 and 50 mm in steps of 1.25 mm"


def test_encoders_without_new_samples_stop_the_robot() -> None:
    writer = Writer()
    writer.acts = [Readings(), Boot()]
    writer.begin()
    for i in range(200):  # 15 counts of 0.13 mm in 10 ms
        writer.read(Readings(encoders=(15 * i, 15 * i)))
        writer.inform(VelocitySetpoint(2000, 0, 200, i & 0xFF), after_us=10_000)
    moving = len(writer.acts)
    writer.read(Readings(encoders=(2985, 2985), encoders_frozen=True))
    for i in range(200, 300):
        writer.inform(VelocitySetpoint(2000, 0, 200, i & 0xFF), after_us=10_000)
    steps = [act for act in writer.acts[moving:] if isinstance(act, Step)]
    reports = script_board().run(writer.acts)[-len(steps) :]
    assert reports[0].motors[0] > 1000
    faulty = next(i for i, r in enumerate(reports) if r.faults & Fault.ENCODER_LEFT)
    assert 0.01 * faulty == pytest.approx(0.5, abs=0.05)
    assert reports[-1].stop_cause == StopCause.HARDWARE


def test_a_stop_takes_no_longer_if_control_periods_are_missed() -> None:
    lasting_s = []
    for misses in (False, True):
        writer = Writer()
        writer.acts = [Readings(), Boot(misses_periods=misses)]
        writer.begin()
        writer.drive(3000, 0, 40)
        begun = len(writer.acts)
        writer.inform(Stop(7, StopCause.OPERATOR), after_us=0)
        for _ in range(200):
            writer.wait(10_000)
        reports = script_board().run(writer.acts)[begun - len(writer.acts) :]
        assert reports[0].motors[0] > 1000
        lasting_s.append(0.01 * next(i for i, r in enumerate(reports) if r.motors == (0, 0)))
    assert lasting_s[0] > 0.3
    assert lasting_s[1] == pytest.approx(lasting_s[0], abs=0.05)


def test_no_heap_and_no_other_library() -> None:
    """The core calls only functions for memory, strings and single-precision numbers."""
    allowed = {
        *("math.h", "stdbool.h", "stddef.h", "stdint.h", "string.h"),
        *(path.name for path in (FIRMWARE / "core").glob("*.h")),
        *("board.h", "firmware.h", *render("c")),
    }
    for path in (*CORE, FIRMWARE / "core" / "main.c", *(FIRMWARE / "core").glob("*.h")):
        named = {
            line.split()[1].strip('<>"')
            for line in path.read_text().splitlines()
            if line.startswith("#include")
        }
        assert named - {"ROBOT_CONFIG"} <= allowed, path.name
        assert "alloc(" not in path.read_text(), path.name


def test_the_static_checkers_are_content() -> None:
    command = (tool("make"), "-s", "-C", FIRMWARE, "analyse", f"CPPCHECK={locked('cppcheck')}")
    run(command, timeout_s=300.0)


def test_connect_accepts_it_on_a_desk(tmp_path: Path) -> None:
    """On a pseudo-terminal in real time, the handshake succeeds and no frame is lost."""
    sources = [FIRMWARE / "core" / "main.c", FIRMWARE / "board_host" / "desk.c"]
    program = compile_core(tmp_path / "desk", wire(tmp_path), sources)
    check_that_connect_accepts(program, tmp_path)
