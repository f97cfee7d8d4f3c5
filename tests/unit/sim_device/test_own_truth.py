"""The emulator computes the true motion itself: it never loads the host's estimation."""

from __future__ import annotations

import ast
from typing import TYPE_CHECKING

import pytest

from support.root import ROOT
from tools.dev import kernels

if TYPE_CHECKING:
    from pathlib import Path

RECKONING = {
    "bridge.motion.estimation.estimator",
    "bridge.motion.estimation.standstill",
    "bridge.motion.estimation.odometry",
    "bridge.motion.estimation.relocalise",
    "bridge.motion.estimation.joint_covariance",
    "bridge.motion.estimation.ekf",
    "bridge.motion.estimation.wall_map",
    "bridge.motion.estimation.wall_measurements",
}


def compiled_kernels() -> set[str]:
    """Return every kernel of the device; other compiled modules are not kernels."""
    made = (source for source in kernels.sources() if not kernels.types(source).exists())
    names = {kernels.module_name(source) for source in made}
    return {name for name in names if name.startswith("sim_device.")}


def file_of(module: str) -> Path | None:
    path = ROOT.joinpath(*module.split("."))
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file.is_file():
            return file
    return None


def imports_of(source: str) -> set[str]:
    """Return the modules and names that a source imports at run time, without typing imports."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            node.body = [ast.Pass()]
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def everything_behind(roots: set[str]) -> set[str]:
    """Return all modules of this project that the roots load, directly or indirectly."""
    seen: set[str] = set()
    waiting = list(roots)
    while waiting:
        module = waiting.pop()
        file = file_of(module)
        if module in seen or file is None:
            continue
        seen.add(module)
        waiting += imports_of(file.read_text(encoding="utf-8"))
    return seen


def test_there_are_kernels_and_the_plant_is_behind_one() -> None:
    compiled = compiled_kernels()
    assert "sim_device.body.drive_kernel" in compiled
    assert compiled & everything_behind({"sim_device.body.plant"})


@pytest.mark.parametrize(
    "root", sorted({"sim_device.body.plant", "sim_device.sensors.sensors"} | compiled_kernels())
)
def test_the_expected_figures_do_not_use_the_hosts_code(root: str) -> None:
    behind = everything_behind({root})
    assert root in behind
    assert behind & RECKONING == set()


def test_the_expected_modules_exist() -> None:
    """Otherwise, the test above would miss a renamed module."""
    for module in RECKONING:
        assert file_of(module) is not None, module
    assert everything_behind({"bridge.motion.estimation.estimator"}) & RECKONING
    assert imports_of("def f():\n from bridge.motion.estimation import odometry") >= {
        "bridge.motion.estimation.odometry"
    }
    assert "a" not in imports_of("if TYPE_CHECKING:\n import a")
