"""The modules that are compiled ahead of time, and a check that they match their sources.

    python -m tools.dev.kernels        exits with 1 if a module is not built or is stale

``pyproject.toml`` lists the modules. The firmware core, a shared library of C sources, is also
compiled ahead of time. ``setup.py`` writes a digest of the inputs into each compiled file, and
``is_stale`` compares this digest with the present inputs.
"""

from __future__ import annotations

import hashlib
import re
import sys
import sysconfig
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SHARED = "bridge/motion/array_views.py"
"""Path that stands for the source of the module with Cython's own array code; no such file exists.

All kernels use this module. Without the module each kernel would contain the array code, and take
twice as long to compile. """
_MADE_WITH = ("setup.py", "requirements-build.lock")
"""Further inputs of every compiled module. The lock file has the version of Cython."""

_ARRAYS = "bridge/motion/arrays.pxd"
"""Further input of a kernel that declares its own types."""
_CIMPORT = re.compile(r"^from ([\w.]+) cimport (\w+)", re.MULTILINE)
CORE = "sim_device/core/core_library.py"
"""Path that stands for the source of the firmware core; its C sources are in ``FIRMWARE``."""
FIRMWARE = "sim_device/firmware"
CORE_FOLDERS = ("board_library", "board_virtual", "core", "include", "protocol")
"""Folders of ``FIRMWARE`` with the sources of the core."""


def sources(*, tests: bool = False) -> list[Path]:
    """Return the sources of all kernels; with ``tests`` also kernels that only tests use."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        named = tomllib.load(file)["tool"]["sweepctl"]["kernels"]
    return [ROOT / path for path in named["modules"] + (named["test-modules"] if tests else [])]


def core_sources() -> list[Path]:
    """Return the C files of the firmware core and of the virtual board."""
    files = [f for folder in CORE_FOLDERS for f in sorted((ROOT / FIRMWARE / folder).glob("*.c"))]
    return [file for file in files if file.name != "main.c"]


def module_name(source: Path) -> str:
    """Return the dotted name of the module that is built from a source."""
    return ".".join(source.relative_to(ROOT).with_suffix("").parts)


def types(source: Path) -> Path:
    """Return the path of the .pxd file of a source, for sources that do not declare C types."""
    return source.with_suffix(".pxd")


def stamp(source: Path) -> str:
    """Return the text that a module built from this source contains."""
    tools = [path for path in map(ROOT.joinpath, _MADE_WITH) if path.exists()]
    typed = _with_cimported(types(source)) if types(source).exists() else [ROOT / _ARRAYS]
    if source == ROOT / CORE:
        folders = [ROOT / FIRMWARE / folder for folder in CORE_FOLDERS]
        made_of = [file for folder in folders for file in sorted(folder.glob("*.[ch]"))]
        made_of.append(ROOT / _MADE_WITH[0])
    else:
        made_of = [source, *typed, *tools]
    digest = hashlib.sha256(b"\0".join(path.read_bytes() for path in made_of)).hexdigest()
    return f"sweepctl-kernel:{module_name(source)}:{digest}"


def _with_cimported(declared: Path) -> list[Path]:
    """Return a .pxd file and all files from which it imports types, directly or indirectly."""
    found, open_ = {declared}, [declared]
    while open_:
        for package, name in _CIMPORT.findall(open_.pop().read_text(encoding="utf-8")):
            place = ROOT.joinpath(*package.split("."))
            near = {place.with_suffix(".pxd"), place / f"{name}.pxd"} - found
            found |= (new := {path for path in near if path.exists()})
            open_ += new
    return sorted(found)


def compiled(source: Path) -> Path:
    """Return the path of the compiled module of a source, for this Python version."""
    return source.with_suffix(sysconfig.get_config_var("EXT_SUFFIX"))


def is_stale(source: Path) -> bool:
    """Return True if a module is not built, or was built from another source."""
    try:
        built = compiled(source).read_bytes()
    except FileNotFoundError:
        return True
    return stamp(source).encode() not in built or not compiled(ROOT / SHARED).exists()


def stale(of: list[Path]) -> list[Path]:
    """Return the sources whose module is not built, or was built from another source."""
    return [source for source in of if is_stale(source)]


def complaint(of: list[Path]) -> str | None:
    """Return one line with the stale modules (also the core) and the remedy; None: all current."""
    names = [module_name(source) for source in stale([*of, ROOT / CORE])]
    if not names:
        return None
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    return f"{names[0]}{more}: not compiled, or of another source; run `make venv`"


if __name__ == "__main__":
    sys.exit(complaint(sources(tests=True)))
