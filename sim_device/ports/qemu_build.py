"""The firmware for the emulated chip: built from its sources when they have changed."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from protocol.generate import render
from sim_device.ports.base import PortUnavailableError

if TYPE_CHECKING:
    from collections.abc import Callable

FIRMWARE = Path(__file__).resolve().parents[1] / "firmware"
COMPILER = "arm-none-eabi-gcc"
BUILD_S = 300.0
_NEEDED = {
    COMPILER: "apt install gcc-arm-none-eabi libnewlib-arm-none-eabi",
    "make": "apt install make",
}
_PARTS = ("include", "core", "board_common", "board_f405_qemu")
_SUFFIXES = {".c", ".h", ".ld"}
ELF = "board_f405_qemu.elf"


class FirmwareBuildError(PortUnavailableError):
    """The firmware cannot be built; one line for people."""


def firmware_elf(cache: Path | None = None, notify: Callable[[str], None] = lambda _: None) -> Path:
    """The firmware's program for the emulated chip, built now if it is not there yet.

    ``notify`` gets a line for people before something takes time.

    It is kept by what it is made of, so that a change of its sources, of the wire's catalogue or
    of the compiler makes another one.

    Raises:
        FirmwareBuildError: a tool is missing (says how to get it), or refuses.

    """
    for tool, remedy in _NEEDED.items():
        if shutil.which(tool) is None:
            raise FirmwareBuildError(
                f"{tool} is not installed, and the firmware for --target qemu is built with it "
                f"(Debian: {remedy})"
            )
    wire = render("c")
    folder = (cache or _cache()) / f"firmware-{_digest(wire)}"
    elf = folder / ELF
    if elf.is_file():
        return elf
    try:
        folder.mkdir(parents=True, exist_ok=True)
        notify("building the firmware, as its sources are new")
        with tempfile.TemporaryDirectory() as build:  # make cannot take a path with blanks
            _build(Path(build), wire)
            whole = folder / f"{ELF}.{os.getpid()}"
            shutil.copyfile(Path(build) / ELF, whole)
            whole.replace(elf)  # at once: another process may build it too
    except OSError as error:
        reason = error.strerror or error
        raise FirmwareBuildError(f"cannot build the firmware in {folder}: {reason}") from None
    return elf


def _build(build: Path, wire: dict[str, str]) -> None:
    generated = build / "wire"
    generated.mkdir()
    for name, text in wire.items():
        (generated / name).write_text(text, encoding="utf-8", newline="\n")
    command = ["make", "--silent", "-C", str(FIRMWARE), "-f", "board.mk"]
    command += [f"BUILD={build}", f"WIRE={generated}", f"PYTHON={sys.executable}"]
    command += [str(build / ELF)]
    try:
        done = subprocess.run(  # noqa: S603 - our own command
            command, capture_output=True, text=True, timeout=BUILD_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise FirmwareBuildError(f"the firmware was not built within {BUILD_S:g} s") from None
    if done.returncode != 0:
        if "nano.specs" in done.stderr or "string.h: No such file" in done.stderr:
            raise FirmwareBuildError(
                "the C library for the chip is not installed, and the firmware for --target qemu "
                "is built with it (Debian: apt install libnewlib-arm-none-eabi)"
            )
        lines = [line for line in done.stderr.splitlines() if "rror" in line] or ["no reason given"]
        raise FirmwareBuildError(f"the firmware cannot be built: {lines[0].strip()}")


def _cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "sweepctl"


def _digest(wire: dict[str, str]) -> str:
    """What the program follows from, as a name."""
    digest = hashlib.sha256()
    sources = [FIRMWARE / "board.mk"]
    for part in _PARTS:
        sources += sorted(p for p in (FIRMWARE / part).rglob("*") if p.suffix in _SUFFIXES)
    for path in sources:
        digest.update(path.relative_to(FIRMWARE).as_posix().encode() + b"\0")
        digest.update(path.read_bytes())
    for name, text in sorted(wire.items()):
        digest.update(name.encode() + b"\0" + text.encode())
    version = subprocess.run(  # noqa: S603 - our own command
        [str(shutil.which(COMPILER)), "--version"], capture_output=True, check=False
    )
    digest.update(version.stdout)
    return digest.hexdigest()[:16]
