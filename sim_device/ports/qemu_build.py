"""Builds the firmware for the emulated chip if its sources have changed."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sysconfig
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from sim_device.ports.base import PortUnavailableError

if TYPE_CHECKING:
    from collections.abc import Callable

FIRMWARE = Path(__file__).resolve().parents[1] / "firmware"
COMPILER = "arm-none-eabi-gcc"
BUILD_S = 300.0
_NEEDED = {
    COMPILER: "apt install gcc-arm-none-eabi libnewlib-arm-none-eabi",
    "cmake": "apt install cmake",
}
_PARTS = ("cmake", "include", "core", "protocol", "board_common", "board_f405_qemu")
_SUFFIXES = {".c", ".h", ".ld", ".cmake"}
ELF = "board_f405_qemu.elf"


class FirmwareBuildError(PortUnavailableError):
    """The firmware cannot be built; the message is one line for the user."""


def firmware_elf(cache: Path | None = None, notify: Callable[[str], None] = lambda _: None) -> Path:
    """Return the firmware for the emulated chip; build it if necessary.

    ``notify`` is called with a line for the user before a slow step.

    The cache key is a hash of the sources and the compiler, so a change of either causes a new
    build.

    Raises:
        FirmwareBuildError: a tool fails or is missing (the message describes its installation).

    """
    for tool, remedy in _NEEDED.items():
        if _found(tool) is None:
            raise FirmwareBuildError(
                f"{tool} is not installed, and the firmware for --target qemu is built with it "
                f"(Debian: {remedy})"
            )
    folder = (cache or _cache()) / f"firmware-{_digest()}"
    elf = folder / ELF
    if elf.is_file():
        return elf
    try:
        folder.mkdir(parents=True, exist_ok=True)
        notify("building the firmware, as its sources are new")
        with tempfile.TemporaryDirectory() as build:
            _build(Path(build))
            whole = folder / f"{ELF}.{os.getpid()}"
            shutil.copyfile(Path(build) / ELF, whole)
            whole.replace(elf)  # atomic, because another process may build at the same time
    except OSError as error:
        reason = error.strerror or error
        raise FirmwareBuildError(f"cannot build the firmware in {folder}: {reason}") from None
    return elf


def _found(tool: str) -> str | None:
    """Return the path of a tool in this Python environment or in the system."""
    return shutil.which(tool, path=sysconfig.get_path("scripts")) or shutil.which(tool)


def _build(build: Path) -> None:
    configure = [str(_found("cmake")), "-S", str(FIRMWARE), "-B", str(build), "-Wno-dev"]
    configure.append(f"-DCMAKE_TOOLCHAIN_FILE={FIRMWARE / 'cmake' / 'cortex-m.cmake'}")
    ninja = _found("ninja")
    if ninja is not None:
        configure += ["-G", "Ninja", f"-DCMAKE_MAKE_PROGRAM={ninja}"]
    _run(configure)
    _run([str(_found("cmake")), "--build", str(build), "--target", Path(ELF).stem])


def _run(command: list[str]) -> None:
    try:
        done = subprocess.run(  # noqa: S603 - our own command
            command, capture_output=True, text=True, timeout=BUILD_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise FirmwareBuildError(f"the firmware was not built within {BUILD_S:g} s") from None
    if done.returncode != 0:
        said = done.stdout + done.stderr
        if "nano.specs" in said or "string.h: No such file" in said:
            raise FirmwareBuildError(
                "the C library for the chip is not installed, and the firmware for --target qemu "
                "is built with it (Debian: apt install libnewlib-arm-none-eabi)"
            )
        lines = [line for line in said.splitlines() if "rror" in line] or ["no reason given"]
        raise FirmwareBuildError(f"the firmware cannot be built: {lines[0].strip()}")


def _cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "sweepctl"


def _digest() -> str:
    """Return a hash of all inputs of the build."""
    digest = hashlib.sha256()
    sources = [FIRMWARE / "CMakeLists.txt"]
    for part in _PARTS:
        sources += sorted(p for p in (FIRMWARE / part).rglob("*") if p.suffix in _SUFFIXES)
    for path in sources:
        digest.update(path.relative_to(FIRMWARE).as_posix().encode() + b"\0")
        digest.update(path.read_bytes())
    version = subprocess.run(  # noqa: S603 - our own command
        [str(shutil.which(COMPILER)), "--version"], capture_output=True, check=False
    )
    digest.update(version.stdout)
    return digest.hexdigest()[:16]
