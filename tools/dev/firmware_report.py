"""Flash, RAM and stack that the firmware uses on its chips. ``make firmware`` prints it.

    python -m tools.dev.firmware_report BUILD

BUILD is the folder into which CMake has built the boards (``sim_device/firmware``).
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from tools.cli.console import inform, write_line
from tools.dev.firmware_stack import Calls, UnboundedStackError, bound

KIB = 1024
_LINK = (
    *("link_uart_handler", "link_received_handler", "link_sent_handler"),
    *("can1_rx0_handler", "can1_tx_handler", "can1_sce_handler"),
)
_IMU = ("i2c1_event_handler", "i2c1_error_handler", "dma1_stream0_handler", "exti9_5_handler")
_MILLISECOND = ("systick_handler",)
_F429 = {2: _LINK, 4: _IMU, 5: ("tim5_handler",), 6: ("flash_handler",), 8: _MILLISECOND}
_PROGRAM = "start_program"
"""The first C function: ``reset_handler`` jumps to it with an empty stack."""


class Board(NamedTuple):
    """A board's memories in bytes, and its interrupts by priority."""

    chip: str
    flash: int
    ram: int
    levels: dict[int, tuple[str, ...]]


BOARDS = {
    "board_f429": Board(
        "STM32F429IGT6",
        512 * KIB,  # the first bank; the second bank contains the parameters
        192 * KIB,
        _F429,
    ),
    "board_nucleo_f429zi": Board(
        "NUCLEO-F429ZI",
        1024 * KIB,  # the first bank
        192 * KIB,
        _F429,
    ),
    "board_f405_qemu": Board(
        "STM32F405 (QEMU)",
        1024 * KIB,
        128 * KIB,
        {4: ("usart1_handler", "usart2_handler"), 8: _MILLISECOND},
    ),
}


class Taken(NamedTuple):
    """Memory that one board's program uses, bytes."""

    flash: int
    ram: int
    """Variables, without the reserve of the stack."""
    stack: int
    """Maximum use of the stack."""
    reserve: int
    """Size that the linker reserves for the stack, bytes."""
    deepest: list[str]


def taken(build: Path, name: str, cross: str = "arm-none-eabi-") -> Taken:
    """Read the sizes from a build.

    Raises:
        UnboundedStackError: the stack has no bound.
        OSError: the compiler or the folder of the build is missing.
        subprocess.CalledProcessError: the folder contains no build.

    """
    elf = build / f"{name}.elf"
    sections = {
        parts[0]: int(parts[1])
        for line in _output(f"{cross}size", "-A", str(elf)).splitlines()
        if len(parts := line.split()) == 3 and parts[1].isdigit()  # noqa: PLR2004 - name, size, place
    }
    calls = Calls()
    for path in sorted((build / "CMakeFiles" / f"{name}.dir").rglob("*.ci")):
        calls.read_graph(path.read_text(encoding="utf-8"))
    calls.read_disassembly(_output(f"{cross}objdump", "-d", str(elf)).splitlines())
    levels = BOARDS[name].levels
    flash = sum(sections.get(s, 0) for s in (".vectors", ".text", ".rodata", ".ARM.exidx", ".data"))
    return Taken(
        flash,
        sections.get(".data", 0) + sections.get(".bss", 0),
        bound(calls, _PROGRAM, levels),
        sections[".stack"],
        calls.deepest(_PROGRAM)[1],
    )


def _output(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603 - ours
    return done.stdout


def main(arguments: list[str]) -> int:
    """Print the table; return 1 if a stack may exceed its reserve, 2 without a build."""
    if len(arguments) != 1:
        inform("usage: python -m tools.dev.firmware_report BUILD")
        return 2
    build = Path(arguments[0])
    worst = 0
    row = "{:<18} {:>15} {:>16} {:>20}"
    write_line(row.format("", "flash", "RAM", "stack, of reserve"))
    for name, board in BOARDS.items():
        try:
            took = taken(build, name)
        except (OSError, subprocess.CalledProcessError) as error:
            inform(f"{build} holds no build of {name}, or no compiler: {error}")
            return 2
        except UnboundedStackError as error:
            inform(f"{name}: the stack has no bound: {error}")
            return 1
        ram = took.ram + took.reserve
        write_line(
            row.format(
                board.chip,
                f"{took.flash} B {100 * took.flash / board.flash:4.1f} %",
                f"{ram} B {100 * ram / board.ram:4.1f} %",
                f"{took.stack} of {took.reserve} B",
            )
        )
        deepest = [call.rsplit("/firmware/", 1)[-1] for call in took.deepest]
        write_line(f"  deepest: {' > '.join(deepest)}")
        worst = max(worst, took.stack - took.reserve)
    if worst > 0:
        inform(f"a stack may outgrow its reserve by {worst} B")
    return int(worst > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
