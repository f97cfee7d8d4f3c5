"""Missing and stale compiled modules are detected before any test runs."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from support.root import ROOT
from tools.dev import kernels

if TYPE_CHECKING:
    from pathlib import Path

REJECTED = """
import sys
from pathlib import Path
import pytest
from tools.dev import kernels
kernels.compiled = lambda source: Path("/nowhere") / source.name
sys.exit(pytest.main(["--collect-only", "-q", "tests/unit/tools/test_stale_kernels.py"]))
"""


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a kernel that is freshly built in a separate tree."""
    monkeypatch.setattr(kernels, "ROOT", tmp_path)
    (tmp_path / "setup.py").write_text("flags")
    (tmp_path / "bridge" / "motion").mkdir(parents=True)
    (tmp_path / "bridge" / "motion" / "arrays.pxd").write_text("types")
    path = tmp_path / "bridge" / "a_kernel.py"
    path.write_text("x = 1\n")
    (tmp_path / "requirements-build.lock").write_text("cython==3")
    kernels.compiled(path).write_bytes(b"\x7fELF" + kernels.stamp(path).encode() + b"\0")
    kernels.compiled(tmp_path / kernels.SHARED).touch()
    core = tmp_path / kernels.CORE
    kernels.compiled(core).parent.mkdir(parents=True)
    kernels.compiled(core).write_bytes(kernels.stamp(core).encode())
    return path


def test_a_module_of_this_source_is_fresh(source: Path) -> None:
    assert kernels.stale([source]) == []
    assert kernels.complaint([source]) is None


@pytest.mark.parametrize(
    "changed",
    ["bridge/a_kernel.py", "bridge/motion/arrays.pxd", "setup.py", "requirements-build.lock"],
)
def test_a_module_of_another_source_is_stale(source: Path, changed: str) -> None:
    path = kernels.ROOT / changed
    path.write_text(path.read_text() + "\n")
    assert kernels.stale([source]) == [source]


@pytest.mark.parametrize("changed", ["bridge/typed.pxd", "bridge/used/deep.pxd"])
def test_a_module_with_types_of_a_changed_file_is_stale(source: Path, changed: str) -> None:
    typed = source.with_name("typed.py")
    typed.write_text("x = 1\n")
    (kernels.ROOT / "bridge" / "used").mkdir()
    for name, text in (
        ("typed.pxd", "from bridge.near cimport Near\n"),
        ("near.pxd", "from bridge.used cimport deep\n"),
        ("used/deep.pxd", "cdef class Deep:\n    pass\n"),
        ("other.pxd", "cdef class Other:\n    pass\n"),
    ):
        (kernels.ROOT / "bridge" / name).write_text(text)
    kernels.compiled(typed).write_bytes(kernels.stamp(typed).encode())
    (kernels.ROOT / "bridge" / "other.pxd").write_text("changed")
    assert kernels.stale([typed]) == []
    path = kernels.ROOT / changed
    path.write_text(path.read_text() + "\n")
    assert kernels.stale([typed]) == [typed]


def test_a_missing_module_is_stale_and_named_in_one_line(source: Path) -> None:
    kernels.compiled(source).unlink()
    text = kernels.complaint([source])
    assert text == "bridge.a_kernel: not compiled, or of another source; run `make venv`"


def test_without_the_shared_module_every_kernel_is_stale(source: Path) -> None:
    kernels.compiled(kernels.ROOT / kernels.SHARED).unlink()
    assert kernels.stale([source]) == [source]


def test_the_tests_do_not_begin_without_compiled_kernels() -> None:
    done = subprocess.run(
        [sys.executable, "-c", REJECTED], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == pytest.ExitCode.USAGE_ERROR
    (line,) = (text for text in done.stderr.splitlines() if text)
    more = len(kernels.sources(tests=True))  # plus the core, minus the first kernel
    assert f"and {more} more: not compiled, or of another source; run `make venv`" in line


def test_every_kernel_is_listed_with_a_source() -> None:
    listed = kernels.sources(tests=True)
    assert [path for path in listed if not path.is_file()] == []
    using = {
        path
        for folder in ("bridge", "sim_device", "tools", "protocol", "tests")
        for path in (ROOT / folder).rglob("*.py")
        if "\nimport cython\n" in path.read_text(encoding="utf-8")
    }
    assert using == {path for path in listed if not kernels.types(path).is_file()}
