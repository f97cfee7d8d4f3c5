"""examples/firmware: built and tested as a user does, on a copy."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tomllib
from typing import TYPE_CHECKING

import pytest

from support.c_build import locked
from support.plugin_site import install
from support.processes import environment
from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = [pytest.mark.slow, pytest.mark.needs("gcc")]

EXAMPLE = ROOT / "examples" / "firmware"


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """The folder in a tree of its own, with sweepctl's sources where they are expected."""
    copy = tmp_path / "examples" / "firmware"
    shutil.copytree(EXAMPLE, copy, ignore=shutil.ignore_patterns("build", "__pycache__"))
    (tmp_path / "sim_device").symlink_to(ROOT / "sim_device")
    package = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    messages = package["entry-points"]["sweepctl.messages"]
    install(copy, package["name"], {"messages": messages})
    return copy


def make(project: Path, *arguments: str) -> str:
    path = f"{project}:{ROOT}"
    done = subprocess.run(
        ["make", f"PYTHON={sys.executable}", f"CMAKE={locked('cmake')}", *arguments],  # noqa: S607
        cwd=project,
        env=environment(PYTHONPATH=path),
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_it_builds_and_its_tests_pass(project: Path) -> None:
    assert "3 passed" in make(project, "test")
