"""The C core on this computer: it is built once per test run and executes scripts."""

from __future__ import annotations

import atexit
import functools
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from protocol.generate import render
from support.c_build import MORE, STRICT, any_compiler
from support.root import ROOT
from support.script_format import read, script

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from support.script_format import Act, Reported

FIRMWARE = ROOT / "sim_device" / "firmware"
CORE = sorted(p for p in (FIRMWARE / "core").glob("*.c") if p.name != "main.c")


def wire(directory: Path) -> Path:
    """Write the generated codec to the folder ``wire`` in ``directory``."""
    folder = directory / "wire"
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in render("c").items():
        (folder / name).write_text(text)
    return folder


def compile_core(  # noqa: PLR0913 - options of a build
    out: Path,
    wire_folder: Path,
    sources: Sequence[Path],
    *,
    flags: Sequence[str] = (),
    sanitized: bool = False,
    core: Path = FIRMWARE / "core",
) -> Path:
    """Compile the core with ``sources``, every warning as an error; return the output's path."""
    includes = (f"-I{FIRMWARE / 'include'}", f"-I{core}", f"-I{wire_folder}")
    files = [
        *(core / source.name for source in CORE),
        wire_folder / "sweepctl_protocol.c",
        *sources,
    ]
    compiler = any_compiler("gcc", "clang")
    checks = compiler.sanitized if sanitized else ()
    compiler.run(
        *STRICT,
        *MORE,
        "-Wno-unused-parameter",
        *includes,
        *checks,
        *flags,
        *files,
        "-lm",
        "-o",
        out,
    )
    return out


@dataclass(frozen=True)
class ScriptBoard:
    """The compiled script board: the C firmware with a board that executes a script."""

    program: Path

    def run(self, acts: Iterable[Act]) -> list[Reported]:
        """Run a script; return the state after each step."""
        return read(self.raw(script(acts)))

    def raw(self, data: bytes) -> bytes:
        """Run arbitrary bytes as a script; the test fails if the sanitizers report an error."""
        done = subprocess.run(
            [self.program], input=data, capture_output=True, timeout=60, check=False
        )
        if done.returncode:
            pytest.fail(f"exit {done.returncode}\n{done.stderr.decode(errors='replace')}")
        return done.stdout


LIBRARY = [FIRMWARE / "board_library" / name for name in ("board.c", "library.c")]


@functools.cache
def library(*sources: Path, sanitized: bool = False, optimised: bool = False) -> Path:
    """Build the core and ``sources`` as a shared library, once per test run."""
    directory = Path(tempfile.mkdtemp(prefix="library-"))
    atexit.register(shutil.rmtree, directory, ignore_errors=True)
    flags = ("-O2" if optimised else "-O0", "-g", "-fPIC", "-shared", "-fvisibility=hidden")
    return compile_core(
        directory / "firmware.so", wire(directory), sources, flags=flags, sanitized=sanitized
    )


@functools.cache
def script_board() -> ScriptBoard:
    """Build the core with the compiler's sanitizers, once per test run."""
    directory = Path(tempfile.mkdtemp(prefix="core-"))
    atexit.register(shutil.rmtree, directory, ignore_errors=True)
    sources = [FIRMWARE / "board_host" / name for name in ("script.c", "script_main.c")]
    flags = ("-O0", "-g")  # builds in half the time of -O1
    out = directory / "script_host"
    return ScriptBoard(compile_core(out, wire(directory), sources, flags=flags, sanitized=True))
