"""The firmware's binary on an emulated chip: build, run, stop, reset, loss of the host."""

from __future__ import annotations

import os
import re
import signal
import struct
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from bridge.io.ports import open_port
from protocol.messages.device import Hello, Status
from protocol.messages.values import Fault, Mode, ResetCause, StopCause
from sim_device.ports.qemu_build import FirmwareBuildError, firmware_elf
from support.c_build import run, tool
from support.cli import end, start, sweepctl
from support.gdb_stub import halted_chip
from support.probe import Probe
from support.qemu import READY_S, build, emulated, finish, true_coverage
from support.root import ROOT
from support.waiting import until
from tools.dev.firmware_report import BOARDS, taken

if TYPE_CHECKING:
    from collections.abc import Iterator

    from support.gdb_stub import Debugger
    from support.qemu import Emulated

pytestmark = pytest.mark.realtime

CROSS = pytest.mark.needs("arm-none-eabi-gcc")
CHIP = pytest.mark.needs("arm-none-eabi-gcc", "qemu-system-arm")

FLOOR = ROOT / "tests" / "conformance" / "floor.json"
RAMP_S = 0.20 / 1.0
"""Time from the cruise speed to rest, s, at the deceleration limit in the parameters."""
WHEELS_S = 0.15
"""Time in which the wheels follow a change of the duty, s: three time constants of the motors."""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder with the programs of both boards."""
    return build(tmp_path_factory.mktemp("firmware"))


@pytest.fixture(scope="module")
def device(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Emulated]:
    """Yield one emulator, shared by the checks that do not change it."""
    folder = tmp_path_factory.mktemp("emulated")
    with emulated(built / "board_f405_qemu.elf", folder, str(FLOOR), "--seed", "3") as made:
        yield made


def probe(device: Emulated) -> Probe:
    return Probe(open_port(device.port))


# ---- build -----------------------------------------------------------------------------


@CROSS
@pytest.mark.parametrize("name", BOARDS)
def test_size_and_stack(built: Path, name: str) -> None:
    """The firmware uses at most a quarter of each memory, and its stack fits into its space."""
    took, board = taken(built, name), BOARDS[name]
    assert 10_000 < took.flash < board.flash / 4
    assert took.ram + took.reserve < board.ram / 4
    assert 200 < took.stack < took.reserve / 2, took.deepest
    assert took.deepest[:2] == ["start_program", "main"]


@CROSS
def test_the_core_has_no_global_variables(built: Path) -> None:
    """The caller owns the core's state: only ``main`` has a global device."""
    folder = built / "CMakeFiles" / "board_f405_qemu.dir" / "core"
    sizes = run([tool("arm-none-eabi-size"), *sorted(folder.glob("*.obj"))]).decode().splitlines()
    with_variables = {
        Path(columns[-1]).name
        for columns in (line.split() for line in sizes[1:])
        if columns[1] != "0" or columns[2] != "0"
    }
    assert with_variables == {"main.c.obj"}


@CROSS
def test_the_cache_key_covers_the_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reported: list[str] = []
    elf = firmware_elf(tmp_path, reported.append)
    assert elf.read_bytes().startswith(b"\x7fELF")
    assert len(reported) == 1
    assert firmware_elf(tmp_path, reported.append) == elf
    assert len(reported) == 1, "what is there is not built again"
    assert [p.name for p in elf.parent.iterdir()] == [elf.name]
    monkeypatch.setenv("PATH", "/nonexistent")
    with pytest.raises(FirmwareBuildError, match="apt install gcc-arm-none-eabi"):
        firmware_elf(tmp_path)


def test_missing_parts_are_named(tmp_path: Path) -> None:
    process = start("emulate", "--target", "qemu", cwd=tmp_path, env={"PATH": "/nonexistent"})
    done = end(process)
    assert (done.status, done.out) == (3, "")
    assert "qemu-system-arm is not installed" in done.line
    assert "apt install qemu-system-arm" in done.line


@CHIP
def test_a_program_for_another_chip(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.elf"
    wrong.write_bytes(b"\x7fELF" + bytes(100))
    done = end(start("emulate", "--target", "qemu", "--firmware", wrong, cwd=tmp_path))
    assert (done.status, done.out) == (3, "")
    assert f"{wrong} does not run: QEMU has ended by itself" in done.line


@CHIP
@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--link", "slcan"], "no CAN"),
        (["--link", "udpcan"], "no CAN"),
        (["--fault", "clock-jump@3"], "keeps its own time"),
        (["--fault", "clock-drift@3"], "keeps its own time"),
    ],
)
def test_unsupported_requests_are_rejected(built: Path, arguments: list[str], why: str) -> None:
    program = built / "board_f405_qemu.elf"
    done = sweepctl("emulate", "--target", "qemu", "--firmware", program, *arguments)
    assert (done.status, done.out) == (2, "")
    assert why in done.err.strip().splitlines()[-1]


# ---- run -------------------------------------------------------------------------------


@CHIP
def test_conformance(device: Emulated, tmp_path: Path) -> None:
    """The test runs the safe and fast checks of the suite that `pytest --port PORT` runs."""
    report = tmp_path / "report.json"
    chosen = "test_stop.py or test_handshake.py or test_commands.py or test_it_follows_a_setpoint"
    done = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-q", f"--port={device.port}", "--allow-motion"),
            *("-m", "not slow", "-k", chosen, f"--conformance-report={report}"),
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=100.0,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:]
    assert report.is_file()


@CHIP
def test_its_stack_is_within_the_bound(built: Path, tmp_path: Path) -> None:
    """Maximum stack of a running chip, compared with the sum over its call graph."""
    took = taken(built, "board_f405_qemu")
    with emulated(built / "board_f405_qemu.elf", tmp_path, "empty", "--stats") as made:
        host = start("connect", made.port, "--duration", "2", cwd=tmp_path)
        assert end(host).status == 0
        done = finish(made.process)
    printed = next(line for line in done.err.splitlines() if "stack" in line)
    used = took.reserve - int(printed.split()[0])
    assert 100 < used <= took.stack


@CHIP
def test_the_first_seconds_of_a_clean(built: Path, tmp_path: Path) -> None:
    """`make qemu` cleans the room to its end; this test ends after some swept floor."""
    truth = tmp_path / "truth.mcap"
    with emulated(
        built / "board_f405_qemu.elf", tmp_path, "case-1", "--truth", truth, "--seed", "1"
    ) as made:
        host = start(
            *("connect", made.port, "--plan", "recovery", "--duration", "10", "--json"),
            cwd=tmp_path,
        )
        done = end(host)
        counted = made.truth()
    assert (done.status, done.json["outcome"]) == (0, "stopped"), done.err
    assert done.json["wire"]["lost"] == done.json["wire"]["crc_errors"] == 0
    assert counted["path_m"] > 0.5
    assert counted["collisions"] == 0
    assert true_coverage(truth, "case-1") > 0.02


@CHIP
def test_a_host_that_is_killed(device: Emulated, tmp_path: Path) -> None:
    """The wheels rest after a setpoint's life and a ramp; a second later a stop latches."""
    host = start("connect", device.port, "--plan", "recovery", "--json", cwd=tmp_path)
    until(lambda: device.truth()["v_m_s"] > 0.1, within_s=READY_S, what="it drives")
    host.kill()
    killed = device.truth()
    host.communicate()
    last: dict[str, Any] = killed
    while abs(last["v_m_s"]) > 0.005 or abs(last["yaw_rate_rad_s"]) > 0.03:
        last = device.truth()
        assert last["time_s"] - killed["time_s"] < 5.0, last
    rested_s = last["time_s"] - killed["time_s"]
    assert rested_s <= 0.25 + RAMP_S + WHEELS_S
    with_probe = probe(device)
    try:
        until(
            lambda: _latched(with_probe) is StopCause.LINK,
            within_s=5.0,
            what="it latches for silence",
        )
        where = device.truth()
        assert abs(where["v_m_s"]) < 0.005
        assert where["path_m"] - last["path_m"] < 0.005, "and stays where it is"
    finally:
        with_probe.port.close()


def _latched(host: Probe) -> StopCause:
    host.handshake()
    return StopCause(host.status().stop_cause)


@CHIP
def test_a_stop_holds_until_it_is_cleared(device: Emulated) -> None:
    host = probe(device)
    try:
        host.handshake()
        host.free()
        host.enter(Mode.VELOCITY)
        host.keep_saying(lambda: host.setpoint(0.15, 0.0), 1.0)
        assert device.truth()["v_m_s"] > 0.1
        host.stop(StopCause.OPERATOR)
        stopped_s = device.truth()["time_s"]
        host.keep_saying(lambda: host.setpoint(0.15, 0.0), 1.5)
        truth = device.truth()
        assert truth["time_s"] - stopped_s > 1.0
        assert abs(truth["v_m_s"]) < 0.005, "setpoints move nothing now"
        status = host.status()
        assert (status.mode, status.stop_cause) == (Mode.IDLE, StopCause.OPERATOR)
    finally:
        host.port.close()


@CHIP
@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        ("reset:cause=pin", ResetCause.PIN),
        ("hang", ResetCause.WATCHDOG),
        ("brown-out:off=0.3", ResetCause.BROWN_OUT),
    ],
)
def test_a_reset_is_reported_and_latched(device: Emulated, fault: str, cause: ResetCause) -> None:
    """The reset is from outside, or by the chip's own watchdog on a program that hangs."""
    host = probe(device)
    try:
        before = host.handshake()
        device.ask(f"start {fault}")
        until(lambda: _booted(host, before), within_s=5.0, what="it boots anew")
        hello = host.handshake()
        assert hello.reset_cause == cause
        assert hello.uid == before.uid
        assert hello.boot_id != before.boot_id
        status: Status = host.status()
        assert (status.mode, status.stop_cause) == (Mode.IDLE, StopCause.SESSION_END)
    finally:
        host.port.close()


def _booted(host: Probe, before: Hello) -> bool:
    host.listen(0.2, alive=False)
    hellos = [h.message for h in host.received if isinstance(h.message, Hello)]
    return any(hello.boot_id != before.boot_id for hello in hellos)


@CHIP
def test_faults_of_body_and_sensors_work(device: Emulated) -> None:
    host = probe(device)
    try:
        host.handshake()
        assert not host.status().faults & ~Fault.DRIVERS_OFF
        device.ask("start battery-flat:charge=0.02")
        until(
            lambda: bool(host.status().faults & Fault.BATTERY_LOW),
            within_s=5.0,
            what="the battery is low",
        )
    finally:
        device.ask("start battery-flat:charge=1.0")
        host.port.close()


# ---- start without a reset, and unused interrupts --------------------------------------

SYSTICK_CTRL, NVIC_ISER, NVIC_ISPR, SCB_ICSR = 0xE000_E010, 0xE000_E100, 0xE000_E200, 0xE000_ED04
PENDSTSET = 1 << 26
INTERRUPTS = 91
"""Number of interrupts of the STM32F429 (RM0090, table 62); the F405 has fewer."""
SYSTICK = 15
USART1 = 37
ICRST, DCRST = 1 << 11, 1 << 12
HARD_FAULT = 3
FIRST_INTERRUPT = 16


@pytest.fixture
def debugger(built: Path) -> Iterator[Debugger]:
    with halted_chip(built / "board_f405_qemu.elf") as connected:
        yield connected


@CHIP
def test_a_start_without_a_reset_begins_like_a_start_after_a_reset(debugger: Debugger) -> None:
    """As with gdb's `load` and `continue`; interrupts are enabled and pending."""
    debugger.run_to("main")
    first_stack = debugger.stack_pointer
    debugger.run_to("systick_handler")
    debugger.run_to("plant_send")
    assert debugger.exception == 0
    debugger.stack_pointer -= 256
    debugger.start_without_reset()
    debugger.run_to("start_program")
    debugger.store(SCB_ICSR, PENDSTSET)
    for i in range(3):
        debugger.store(NVIC_ISER + 4 * i, 0xFFFF_FFFF)
        debugger.store(NVIC_ISPR + 4 * i, 0xFFFF_FFFF)
    debugger.run_to("main", never=["fault_handler", "systick_handler", "usart1_handler"])
    assert debugger.stack_pointer == first_stack
    assert debugger.exception == 0
    assert debugger.word(SYSTICK_CTRL) & 1 == 0
    assert debugger.word(SCB_ICSR) & PENDSTSET == 0
    assert debugger.words(NVIC_ISER, 3) == [0, 0, 0]
    assert debugger.words(NVIC_ISPR, 3) == [0, 0, 0]
    debugger.run_to("systick_handler")


@CHIP
def test_the_start_empties_the_flash_caches_first(built: Path, tmp_path: Path) -> None:
    """Code and constants of the previous program may be in them."""
    log = tmp_path / "unemulated.log"
    with halted_chip(built / "board_f405_qemu.elf", log) as debugger:
        debugger.run_to("main")
    written = re.findall(r"(.+): unimplemented device write .*value 0x(\w+)\)", log.read_text())
    assert [(device, int(value, 16)) for device, value in written[:3]] == [
        ("Flash Int", 0),
        ("Flash Int", ICRST | DCRST),
        ("Flash Int", 0),
    ]


@CHIP
def test_an_old_pending_interrupt_does_not_run(debugger: Debugger) -> None:
    """The request comes after the start has cleared it, and its flag is not set."""
    debugger.run_to("board_start")
    debugger.store(NVIC_ISPR + 4 * (USART1 // 32), 1 << USART1 % 32)
    debugger.run_to("plant_send", never=["usart1_handler"])
    assert debugger.word(NVIC_ISER + 4 * (USART1 // 32)) >> USART1 % 32 & 1 == 1


@CHIP
def test_a_start_from_an_interrupt_handler_resets_the_chip(debugger: Debugger) -> None:
    """Otherwise the handler would mask all interrupts of equal or lower priority for ever."""
    debugger.run_to("systick_handler")
    assert debugger.exception == SYSTICK
    debugger.start_without_reset()
    debugger.run_to("main")
    assert debugger.exception == 0
    debugger.run_to("systick_handler")


@CHIP
@pytest.mark.parametrize(
    ("interrupt", "exception"),
    [
        pytest.param(60, HARD_FAULT, id="an entry of zero"),
        pytest.param(90, FIRST_INTERRUPT + 90, id="the last entry"),
    ],
)
def test_an_unexpected_interrupt_calls_the_fault_handler(
    debugger: Debugger, interrupt: int, exception: int
) -> None:
    debugger.run_to("plant_send")
    debugger.store(NVIC_ISER + 4 * (interrupt // 32), 1 << interrupt % 32)
    debugger.store(NVIC_ISPR + 4 * (interrupt // 32), 1 << interrupt % 32)
    debugger.run_to("fault_handler")
    assert debugger.exception == exception
    debugger.run_to("main")


@CHIP
def test_a_crash_is_reported_once(debugger: Debugger) -> None:
    """The record stays in memory during each later reset."""
    assert debugger.result_of("startup_take_crash") == 0
    debugger.run_to("plant_send")
    debugger.store(NVIC_ISER, 1)
    debugger.store(NVIC_ISPR, 1)
    debugger.run_to("fault_handler")
    assert debugger.result_of("startup_take_crash") != 0
    for _ in range(3):
        debugger.run_to("plant_send")
        debugger.start_without_reset()
        assert debugger.result_of("startup_take_crash") == 0


@CROSS
@pytest.mark.parametrize("name", BOARDS)
def test_the_vector_table_covers_every_interrupt(built: Path, name: str) -> None:
    """The program follows the table, so a shorter table would have code as its last entries."""
    sections = run([tool("arm-none-eabi-size"), "-A", built / f"{name}.elf"]).decode()
    (size,) = re.findall(r"^\.vectors +(\d+)", sections, re.MULTILINE)
    assert int(size) == 4 * (FIRST_INTERRUPT + INTERRUPTS)
    table = struct.unpack(f"<{int(size) // 4}I", (built / f"{name}.bin").read_bytes()[: int(size)])
    assert table[-1] == table[HARD_FAULT]
    assert all(entry % 2 == 1 for entry in table[1:] if entry != 0), "Thumb code"


# ---- without a host --------------------------------------------------------------------


@CHIP
def test_the_end_leaves_nothing(built: Path, tmp_path: Path) -> None:
    with emulated(built / "board_f405_qemu.elf", tmp_path, "empty", "--pty-link", "port") as made:
        assert made.port == "port"
        pid = made.qemu_pid()
    assert not Path(f"/proc/{pid}").exists()
    assert list(tmp_path.iterdir()) == []


@CHIP
def test_qemu_does_not_outlive_an_emulator_that_is_killed(built: Path, tmp_path: Path) -> None:
    with emulated(built / "board_f405_qemu.elf", tmp_path, "empty") as made:
        pid = made.qemu_pid()
        made.process.kill()
        made.process.communicate()
        until(lambda: _gone(pid), within_s=10.0, what="QEMU ends")


def _gone(pid: int) -> bool:
    """Return whether the process is gone, or only its entry is left."""
    try:
        return ") Z" in Path(f"/proc/{pid}/stat").read_text(encoding="ascii")
    except OSError:
        return True


@CHIP
def test_an_emulator_whose_qemu_dies_reports_so(built: Path, tmp_path: Path) -> None:
    with emulated(built / "board_f405_qemu.elf", tmp_path, "empty") as made:
        os.kill(made.qemu_pid(), signal.SIGKILL)
        done = end(made.process)
    assert done.status == 3
    assert "QEMU has ended by itself" in done.err.strip().splitlines()[-1]
    assert "Traceback" not in done.err
