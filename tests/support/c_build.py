"""Compilers for the generated C, and the adapter as a child that answers lines."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from protocol.catalogue import CATALOGUE, Catalogue
from protocol.generate.c import SOURCE, render
from support.c_adapter import table

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

ROOT = Path(__file__).parents[2]
C_TESTS = ROOT / "tests" / "c"
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic")
MORE = ("-Wsign-conversion", "-Wshadow", "-Wdouble-promotion", "-Wundef", "-Wcast-qual")
SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
CORTEX_M4 = ("-mcpu=cortex-m4", "-mthumb", "-Os", "-ffreestanding")
UNIT = ("-DSP_CRC_UNIT", '-DSP_CONFIG_FILE="crc_unit.h"')
_PACKAGES = {
    "gcc": "gcc",
    "clang": "clang",
    "g++": "g++",
    "arm-none-eabi-gcc": "gcc-arm-none-eabi",
    "arm-none-eabi-size": "binutils-arm-none-eabi",
    "arm-none-eabi-nm": "binutils-arm-none-eabi",
    "cppcheck": "cppcheck",
    "make": "make",
    "qemu-system-arm": "qemu-system-arm",
}


def tool(name: str) -> str:
    """Path of a system tool; the test fails where it is missing."""
    path = shutil.which(name)
    if path is None:
        pytest.fail(f"{name} is missing: install Debian package {_PACKAGES[name]}")
    return path


def run(command: Sequence[str | Path], *, data: bytes = b"", timeout_s: float = 100.0) -> bytes:
    """Run to the end; the test fails with what it said where it failed."""
    done = subprocess.run(
        [str(c) for c in command], input=data, capture_output=True, timeout=timeout_s, check=False
    )
    if done.returncode:
        shown = " ".join(str(c) for c in command)
        pytest.fail(f"{shown}\nexit {done.returncode}\n{done.stderr.decode(errors='replace')}")
    return done.stdout


@dataclass(frozen=True)
class Generated:
    """A directory with the generated files and the adapter's table."""

    directory: Path
    catalogue: Catalogue

    @property
    def source(self) -> Path:
        return self.directory / SOURCE

    def compile(
        self,
        name: str,
        sources: Iterable[Path],
        *,
        compiler: str = "clang",
        flags: Sequence[str] = (),
    ) -> Path:
        """Compile with every warning an error; the output's path."""
        out = self.directory / name
        includes = (f"-I{self.directory}", f"-I{C_TESTS}")
        run([tool(compiler), *STRICT, *MORE, *includes, *flags, "-o", out, *sources])
        return out

    def adapter(
        self, name: str = "adapter", *, compiler: str = "clang", flags: Sequence[str] = ()
    ) -> Adapter:
        """Build the adapter."""
        sources = [
            self.source,
            self.directory / "adapter_table.c",
            C_TESTS / "adapter.c",
            *([C_TESTS / "crc_unit.c"] if UNIT[0] in flags else []),
        ]
        return Adapter(self.compile(name, sources, compiler=compiler, flags=("-O1", "-g", *flags)))


@dataclass(frozen=True)
class Adapter:
    """The built adapter."""

    program: Path

    def ask(self, mode: str, lines: Iterable[str]) -> list[str]:
        """Lines in, lines out, in one run."""
        data = "".join(f"{line}\n" for line in lines).encode()
        return run([self.program, mode], data=data).decode().splitlines()


def generate(
    directory: Path, catalogue: Catalogue = CATALOGUE, *, built: Catalogue | None = None
) -> Generated:
    """Write the generated C and the adapter's table (of ``built``, where messages are left out)."""
    directory.mkdir(exist_ok=True)
    for name, text in render(catalogue).items():
        (directory / name).write_text(text, encoding="ascii")
    (directory / "adapter_table.c").write_text(table(built or catalogue), encoding="ascii")
    return Generated(directory, catalogue)
