"""The wheel as users install it: in a separate venv, without Cython and without a compiler."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from support.root import ROOT
from tools.dev import kernels

if TYPE_CHECKING:
    from collections.abc import Sequence

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

PACKAGES = ("protocol", "bridge", "sim_device", "tools")
MODULES = ("sweepctl_plugins.py", "sweepctl_pytest.py")
SOURCES = (*PACKAGES, *MODULES, "setup.py", "pyproject.toml", "README.md", "LICENSE")
BUILT = shutil.ignore_patterns("__pycache__", "build", "*.so", "*.pyd")
NOT_WANTED = ("cython", "pyximport", "sweepctl", "__editable__", "ziglang", "setuptools")
"""Prefixes of package names, in lower case, that must be absent from a user's venv."""

USERS_TESTS = """
import pytest

@pytest.mark.sweeper(room="empty", noise="none")
def test_it_drives(sweeper):
    sweeper.enable()
    sweeper.drive(0.1, 0.0, for_s=2.0)
    assert sweeper.truth.pose.x_m > 0.1
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the wheel from a copy of the sources."""
    folder = tmp_path_factory.mktemp("source")
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, ignore=BUILT)
        else:
            shutil.copy(ROOT / name, folder / name)
    return built(folder, tmp_path_factory.mktemp("wheel"))


def built(source: Path, out: Path) -> Path:
    """Build the wheel of a source folder."""
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*command, "--wheel-dir", str(out), "."], cwd=source, check=True)
    (path,) = out.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def venv(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the wheel with its dependencies, without this checkout and without compilers."""
    folder = tmp_path_factory.mktemp("user") / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    (site,) = folder.glob("lib/python*/site-packages")
    for entry in Path(sysconfig.get_path("purelib")).iterdir():
        if not entry.name.lower().startswith(NOT_WANTED) and entry.suffix != ".pth":
            (site / entry.name).symlink_to(entry)
    install(folder, wheel)
    return folder


def install(venv: Path, wheel: Path) -> None:
    command = [sys.executable, "-m", "pip", "--python", str(venv / "bin" / "python"), "install"]
    subprocess.run([*command, "--quiet", "--no-deps", "--no-index", str(wheel)], check=True)


def run(venv: Path, *command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(venv / "bin" / command[0]), *command[1:]],
        cwd=cwd,
        env=only(venv),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )


def only(venv: Path) -> dict[str, str]:
    """Return an environment with only the venv: no compiler, and no path of this source tree."""
    kept = {name: value for name, value in os.environ.items() if name in {"HOME", "LANG", "TMPDIR"}}
    return {**kept, "PATH": str(venv / "bin")}


def files(names: Sequence[str]) -> set[str]:
    return {name for name in names if ".dist-info/" not in name}


def test_it_holds_every_file_of_the_packages_and_the_compiled_kernels(wheel: Path) -> None:
    source = {
        str(path.relative_to(ROOT))
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file()
        and not {"__pycache__", "build"} & set(path.relative_to(ROOT).parts)
        and path.suffix not in {".so", ".pyd"}
    }
    made = [*kernels.sources(), ROOT / kernels.SHARED, ROOT / kernels.CORE]
    compiled = {str(kernels.compiled(path).relative_to(ROOT)) for path in made}
    with zipfile.ZipFile(wheel) as archive:
        assert files(archive.namelist()) == source | compiled | set(MODULES)


def test_its_kernels_are_compiled_and_nothing_is_there_to_compile_them(
    venv: Path, tmp_path: Path
) -> None:
    names = [kernels.module_name(source) for source in kernels.sources()]
    program = (
        "import importlib, importlib.util, json\n"
        f"found = [importlib.import_module(name).__file__ for name in {names!r}]\n"
        "print(json.dumps([found, importlib.util.find_spec('cython') is None]))\n"
    )
    done = run(venv, "python", "-c", program, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found, lacks_cython = json.loads(done.stdout)
    assert lacks_cython
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    assert [path for path in found if not path.endswith(suffix)] == []
    assert [path for path in found if not path.startswith(str(venv))] == []


def test_help_and_a_short_simulation(venv: Path, tmp_path: Path) -> None:
    done = run(venv, "sweepctl", "--help", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "simulate" in done.stdout
    asked = ("simulate", "case-1", "--max-time", "20", "--json", "--out", "run.mcap")
    done = run(venv, "sweepctl", *asked, cwd=tmp_path)
    assert done.stdout, done.stderr
    assert json.loads(done.stdout)["duration_s"] == pytest.approx(20.0, abs=0.1)


def test_the_emulator_starts_and_ends(venv: Path, tmp_path: Path) -> None:
    emulator = subprocess.Popen(
        [str(venv / "bin" / "sweepctl"), "emulate", "case-1"],
        cwd=tmp_path,
        env=only(venv),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
    )
    with emulator:
        try:
            assert emulator.stdout is not None
            assert emulator.stdout.readline().startswith("ready ")
        finally:
            emulator.send_signal(signal.SIGINT)
        assert emulator.wait(60) == 0


def test_the_pytest_plugin_is_found(venv: Path, tmp_path: Path) -> None:
    (tmp_path / "test_mine.py").write_text(USERS_TESTS)
    done = run(venv, "python", "-m", "pytest", "-q", "-p", "no:cacheprovider", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 passed" in done.stdout


def test_the_plug_ins_of_an_installed_package_are_used(venv: Path, tmp_path: Path) -> None:
    """As docs/plugins.md describes: only a wheel beside ours."""
    shutil.copytree(ROOT / "examples" / "plugin", tmp_path / "plugin", ignore=BUILT)
    install(venv, built(tmp_path / "plugin", tmp_path))
    lines = re.findall(
        r"^sweepctl .*$", (ROOT / "docs" / "plugins.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    for line in lines[:2]:
        done = run(venv, *shlex.split(line), cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"\d+ particles in \d+ messages\n", done.stdout)
    asked = ("simulate", "empty", "--planner", "u-shape", "--max-time", "12", "--out", "run.mcap")
    done = run(
        venv,
        "sweepctl",
        *asked,
        "--fault",
        "clumsy-gyro@1",
        "--supervise-rule",
        "too_far.reaction=off",
        cwd=tmp_path,
    )
    assert "clumsy-gyro" not in done.stderr
    assert done.returncode == 1, "out of time, and nothing else"
    done = run(venv, "sweepctl", "generate", "c", "--out", "firmware", cwd=tmp_path)
    header = (tmp_path / "firmware" / "sweepctl_protocol.h").read_text(encoding="utf-8")
    assert "sp_dust_t" in header, done.stderr
