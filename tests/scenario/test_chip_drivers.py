"""The STM32F429 drivers, run on this computer with simulated registers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from support.c_build import C_TESTS, run, tool
from support.core_build import FIRMWARE, wire

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.needs("gcc")

CHIP = FIRMWARE / "stm32f429"
BOARDS = ("board_f429", "board_nucleo_f429zi")
# The addresses of the registers are constants, and DMA uses 32-bit addresses. So program and heap
# must lie between the peripherals and the processor's own registers.
PLACE = ("-no-pie", "-Wl,-Ttext-segment=0x60000000", "-Wno-int-to-pointer-cast")


@pytest.mark.parametrize("board", BOARDS)
def test_drivers_against_played_hardware(board: str, tmp_path: Path) -> None:
    folder = wire(tmp_path)
    program = tmp_path / "chip"
    includes = [FIRMWARE / part for part in ("include", "core", "board_common", board)] + [
        CHIP,
        folder,
    ]
    sources = [path for path in sorted(CHIP.glob("*.c")) if path.name != "vectors.c"]
    flags = (
        "-std=gnu11",
        "-g",
        "-Wall",
        "-Werror",
        "-Wno-unused-parameter",
        "-fsanitize=undefined",
    )
    tests = (C_TESTS / "chip_f429.c", C_TESTS / "register_watch.c")
    files = (*tests, *sources, folder / "sweepctl_protocol.c")
    run([tool("gcc"), *flags, *PLACE, *(f"-I{i}" for i in includes), *files, "-o", program])
    run([program])


def test_the_inbox_keeps_its_order_between_threads(tmp_path: Path) -> None:
    folder = wire(tmp_path)
    program = tmp_path / "inbox"
    includes = (f"-I{FIRMWARE / 'include'}", f"-I{FIRMWARE / 'core'}", f"-I{folder}")
    files = (C_TESTS / "inbox_threads.c", FIRMWARE / "core" / "inbox.c")
    flags = ("-std=gnu11", "-O2", "-g", "-Wall", "-Werror", "-fsanitize=thread", "-pthread")
    run([tool("gcc"), *flags, *includes, *files, "-o", program])
    run([program])
