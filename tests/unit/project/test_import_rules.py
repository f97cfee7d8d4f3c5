"""Import rules of the pure packages: an allow-list, and the modules that they load at run time.

The contracts of import-linter are not enough. They list forbidden imports, so they would accept a
new library.
"""

from __future__ import annotations

import ast
import subprocess
import sys

import pytest

import bridge
from bridge.api.robot import Robot
from support.root import ROOT

ALLOWED = {
    "protocol": {"protocol", "numpy", "cobs", "sweepctl_plugins"},
    "bridge/motion": {"bridge.motion", "numpy", "scipy"},
    "bridge/coverage": {
        "bridge.coverage",
        "bridge.motion",
        "cython",
        "numpy",
        "scipy",
        "sweepctl_plugins",
    },
}
# Modules of the standard library with access to clocks, ports, processes, hidden randomness and
# logs.
IMPURE = {
    "asyncio",
    "ctypes",
    "logging",
    "multiprocessing",
    "random",
    "secrets",
    "select",
    "selectors",
    "signal",
    "socket",
    "socketserver",
    "subprocess",
    "threading",
    "time",
    "uuid",
}
HEAVY = ("can", "google.protobuf", "matplotlib", "mcap", "rerun", "serial")


def imported_modules(source: str) -> set[str]:
    """Return the dotted names of all imports of ``source``, also in functions and for types."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            found.add("." * node.level + (node.module or ""))
    return found


def strangers(source: str, allowed: set[str]) -> set[str]:
    """Return the imports of ``source`` that are neither allowed nor pure standard library."""
    pure = sys.stdlib_module_names - IMPURE
    return {
        name
        for name in imported_modules(source)
        if name.split(".")[0] not in pure
        and not any(name == ok or name.startswith(f"{ok}.") for ok in allowed)
    }


@pytest.mark.parametrize("package", ALLOWED)
def test_pure_package_imports_only_allowed_modules(package: str) -> None:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    found = {}
    for file in files:
        strange = strangers(file.read_text(encoding="utf-8"), ALLOWED[package])
        if strange:
            found[str(file.relative_to(ROOT))] = strange
    assert found == {}


def test_the_module_that_finds_plug_ins_is_pure_standard_library() -> None:
    source = (ROOT / "sweepctl_plugins.py").read_text(encoding="utf-8")
    assert strangers(source, set()) == set()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("import numpy as np", set()),
        ("from protocol.frame import Frame", set()),
        ("import math, struct", set()),
        ("import protocols", {"protocols"}),
        ("def f() -> None:\n    import time", {"time"}),
        ("from bridge import io", {"bridge"}),
        ("from . import frame", {"."}),
    ],
)
def test_a_stranger_is_found(line: str, expected: set[str]) -> None:
    assert strangers(line, ALLOWED["protocol"]) == expected


@pytest.mark.parametrize("package", ["protocol", "bridge.motion", "bridge.coverage"])
def test_a_pure_package_loads_nothing_heavy(package: str) -> None:
    # In a separate process: `bridge/__init__.py` runs first, and must not import a port.
    program = (
        "import importlib, pkgutil, sys\n"
        f"package = importlib.import_module({package!r})\n"
        f"for module in pkgutil.walk_packages(package.__path__, {package + '.'!r}):\n"
        "    importlib.import_module(module.name)\n"
        f"print(*(name for name in {HEAVY!r} if name in sys.modules))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []


def test_the_library_gives_its_robot_by_name() -> None:
    assert bridge.Robot is Robot
    with pytest.raises(AttributeError, match="no attribute 'Robbot'"):
        getattr(bridge, "Robbot")  # noqa: B009 - a name that a type checker rejects
