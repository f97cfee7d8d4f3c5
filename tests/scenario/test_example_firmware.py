"""examples/firmware, built and tested on a copy as a user does."""

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
    """A copy of the folder, anywhere."""
    copy = tmp_path / "my firmware"
    shutil.copytree(EXAMPLE, copy, ignore=shutil.ignore_patterns("build", "__pycache__"))
    package = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    messages = package["entry-points"]["sweepctl.messages"]
    install(copy, package["name"], {"messages": messages})
    return copy


def run_make(project: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    path = f"{project}:{ROOT}"
    return subprocess.run(
        ["make", f"PYTHON={sys.executable}", f"CMAKE={locked('cmake')}", *arguments],  # noqa: S607
        cwd=project,
        env=environment(PYTHONPATH=path),
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )


def test_it_builds_and_its_tests_pass(project: Path) -> None:
    done = run_make(project, "test")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 passed" in done.stdout


def test_missing_sources_are_named(project: Path, tmp_path: Path) -> None:
    done = run_make(project, f"FIRMWARE={tmp_path / 'nowhere'}")
    assert done.returncode != 0
    assert f"No sweepctl in {tmp_path / 'nowhere'}" in " ".join(done.stderr.split())
