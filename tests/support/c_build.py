"""Compilers for the generated C, and the adapter as a child process that answers lines."""

from __future__ import annotations

import shutil
import subprocess
import sys
import sysconfig
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest

from protocol.generate.c import SOURCE, render
from protocol.schema.catalogue import CATALOGUE, Catalogue
from support.c_adapter import table
from support.root import ROOT
from support.tools import tool_named, unmarked

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

C_TESTS = ROOT / "tests" / "c"
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic")
MORE = ("-Wsign-conversion", "-Wshadow", "-Wdouble-promotion", "-Wundef", "-Wcast-qual")
CORTEX_M4 = ("-mcpu=cortex-m4", "-mthumb", "-Os", "-ffreestanding")
UNIT = ("-DSP_CRC_UNIT", '-DSP_CONFIG_FILE="crc_unit.h"')


@dataclass(frozen=True)
class Compiler:
    """A C compiler of this machine, or of the packages in the lock file."""

    command: tuple[str, ...]
    sanitized: tuple[str, ...] = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    """Options that end the program on undefined behaviour, and on memory errors if possible."""
    tool: str = ""
    """Tool that may start without a mark, because the compiler in the lock file could replace it.
    """

    def run(self, *arguments: str | Path) -> None:
        """Compile; the test fails with the compiler's output."""
        with unmarked(self.tool):
            run([*self.command, *arguments])


ZIG = Compiler(
    (sys.executable, "-m", "ziglang", "cc"),
    # Zig has no AddressSanitizer. A trap ends the program on undefined behaviour, because the code
    # that reports it takes 20 s to build.
    ("-fsanitize=undefined", "-fsanitize-trap=undefined"),
)
"""Clang from the `ziglang` wheel: available on every machine."""

COMPILERS = [
    pytest.param("gcc", marks=pytest.mark.needs("gcc")),
    pytest.param("clang", marks=pytest.mark.needs("clang")),
    "zig",
]
"""Parameters of a test that every compiler must pass."""


def compiler(name: str) -> Compiler:
    """Return the system's compiler of this name, or ``zig``."""
    return ZIG if name == "zig" else Compiler((tool(name),))


def any_compiler(*preferred: str) -> Compiler:
    """Return the first available compiler of the system, else the compiler from the lock file."""
    for name in preferred:
        if tool_named(name).present():
            return Compiler((tool(name),), tool=name)
    return ZIG


def tool(name: str) -> str:
    """Return the path of a system program; the test fails if it is missing."""
    path = shutil.which(name)
    if path is None:
        pytest.fail(f"{name} is missing, and the test lacks its mark `needs`")
    return path


def locked(name: str) -> str:
    """Return the path of a program from a package in the lock file, in this environment."""
    path = shutil.which(name, path=sysconfig.get_path("scripts"))
    if path is None:
        pytest.fail(f"{name} is not in {sysconfig.get_path('scripts')}: `make venv` installs it")
    return path


def run(command: Sequence[str | Path], *, data: bytes = b"", timeout_s: float = 100.0) -> bytes:
    """Run a command to its end; on failure the test fails with its output."""
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
        compiler: Compiler | None = None,
        flags: Sequence[str] = (),
        sanitized: bool = False,
    ) -> Path:
        """Compile with every warning as an error; return the output's path."""
        chosen = compiler or any_compiler("clang", "gcc")
        out = self.directory / name
        includes = (f"-I{self.directory}", f"-I{C_TESTS}")
        checks = chosen.sanitized if sanitized else ()
        chosen.run(*STRICT, *MORE, *includes, *checks, *flags, "-o", out, *sources)
        return out

    def adapter(
        self,
        name: str = "adapter",
        *,
        compiler: Compiler | None = None,
        flags: Sequence[str] = (),
        sanitized: bool = False,
    ) -> Adapter:
        """Build the adapter."""
        sources = [
            self.source,
            self.directory / "adapter_table.c",
            C_TESTS / "adapter.c",
            *([C_TESTS / "crc_unit.c"] if UNIT[0] in flags else []),
        ]
        flags = ("-O1", "-g", *flags)
        return Adapter(
            self.compile(name, sources, compiler=compiler, flags=flags, sanitized=sanitized)
        )


@dataclass(frozen=True)
class Adapter:
    """The built adapter."""

    program: Path

    def ask(self, mode: str, lines: Iterable[str]) -> list[str]:
        """Run the adapter once on these lines; return its output lines."""
        data = "".join(f"{line}\n" for line in lines).encode()
        return run([self.program, mode], data=data).decode().splitlines()


def generate(
    directory: Path, catalogue: Catalogue = CATALOGUE, *, built: Catalogue | None = None
) -> Generated:
    """Write the generated C and the adapter's table (of ``built``, if messages are left out)."""
    directory.mkdir(exist_ok=True)
    for name, text in render(catalogue).items():
        (directory / name).write_text(text, encoding="ascii")
    (directory / "adapter_table.c").write_text(table(built or catalogue), encoding="ascii")
    return Generated(directory, catalogue)
