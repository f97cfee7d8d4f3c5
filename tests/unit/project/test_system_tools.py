"""System tools: their registry, the pytest mark ``needs``, and the generated package lists."""

from __future__ import annotations

import os
import re
import stat
import sys
from typing import TYPE_CHECKING

import pytest

from support.needs import block, check_start
from support.root import ROOT
from support.tools import (
    BY_NAME,
    CONTRIBUTING,
    FILES,
    PROGRAMS,
    TOOLS,
    UnknownToolError,
    contributing_text,
    install_command,
    packages_text,
    tool_named,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Run = Callable[..., pytest.RunResult]

pytestmark = pytest.mark.slow

CONFTEST = """
    from support import needs, tools

    ABSENT = tools.Tool(
        "tshark", "reads captures", (("no-such-program",),), tools.BY_NAME["tshark"].packages
    )
    tools.BY_NAME["tshark"] = ABSENT

    def pytest_addoption(parser):
        needs.add_options(parser)

    def pytest_configure(config):
        needs.configure(config)
"""
"""Configuration of a test suite on a machine without tshark."""
SUITE = """
    import pytest

    @pytest.fixture
    def precious():
        raise AssertionError("a fixture was set up for a test that cannot run")

    @pytest.mark.needs("tshark")
    @pytest.mark.parametrize("n", [1, 2])
    def test_captures(n, precious):
        pass

    def test_without():
        pass
"""


@pytest.fixture
def run(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return a function that runs pytest in a separate process on a test file with a given text."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT / "tests"), str(ROOT)]))
    pytester.makeconftest(CONFTEST)

    def started(suite: str, *options: str) -> pytest.RunResult:
        pytester.makepyfile(suite)
        return pytester.runpytest_subprocess("-p", "no:cacheprovider", *options)

    return started


def test_without_its_tool_a_test_is_skipped_and_counted(run: Run) -> None:
    result = run(SUITE)
    result.assert_outcomes(passed=1, skipped=2)
    assert result.ret == 0
    assert "not run, for want of a system tool: 2 tests" in result.outlines
    assert "  tshark     2  reads captures with the generated dissector" in result.outlines
    (how,) = [line for line in result.outlines if line.startswith("install them: ")]
    assert how == "install them: sudo apt-get install --no-install-recommends tshark"


def test_required_tools_make_each_such_test_a_failure_of_one_line(run: Run) -> None:
    result = run(SUITE, "--require-tools", "-q")
    result.assert_outcomes(passed=1, failed=2)
    # The list of failures of pytest repeats each line, sometimes truncated.
    reported = [line for line in result.outlines if line.startswith("missing system tool")]
    how = "sudo apt-get install --no-install-recommends tshark"
    assert reported == [f"missing system tool: tshark; install: {how}"] * 2
    assert not any("precious" in line for line in result.outlines), result.outlines


def test_parallel_workers_count_as_one(run: Run) -> None:
    result = run(SUITE, "-n", "2")
    assert "not run, for want of a system tool: 2 tests" in result.outlines


def test_a_mark_of_an_unknown_tool_is_an_error(run: Run) -> None:
    result = run('import pytest\n@pytest.mark.needs("tsark")\ndef test(): pass\n')
    assert result.ret != 0
    result.stdout.fnmatch_lines(["*the registry has no tool 'tsark'; it has gcc, *"])


@pytest.fixture
def installed(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Callable[[str], Path]:
    """Return a function that installs a program in a folder of PATH that no test owns."""
    folder = tmp_path_factory.mktemp("bin")
    # The suite in the separate process uses another temporary folder.
    elsewhere = tmp_path_factory.mktemp("temporary")
    monkeypatch.setenv("TMPDIR", str(elsewhere))
    monkeypatch.setenv("PATH", str(folder), prepend=os.pathsep)

    def add(name: str) -> Path:
        path = folder / name
        path.write_text("#!/bin/sh\nexit 0\n", encoding="ascii")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return path

    return add


STARTS = """
    import subprocess, os, pytest

    {mark}
    def test_it():
        {start}
"""
WAYS = (
    'subprocess.run(["{name}"], check=True)',
    'os.posix_spawnp("{name}", ["{name}"], {{}})',
    'subprocess.run("exit 0", shell=True, executable="{name}", check=True)',
)


@pytest.mark.parametrize("way", WAYS, ids=["run", "spawn", "shell"])
def test_a_program_that_the_registry_lacks_fails_its_test(
    run: Run, installed: Callable[[str], Path], way: str
) -> None:
    name = installed("strange-tool").name
    result = run(STARTS.format(mark="", start=way.format(name=name)))
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*starts strange-tool, which tests/support/tools.py does not*"])


def test_a_registered_program_wants_its_mark(run: Run, installed: Callable[[str], Path]) -> None:
    installed("qemu-system-arm")
    start = WAYS[0].format(name="qemu-system-arm")
    result = run(STARTS.format(mark="", start=start))
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(['*starts qemu-system-arm without the mark needs("qemu-*")*'])
    mark = '@pytest.mark.needs("qemu-system-arm")'
    run(STARTS.format(mark=mark, start=start)).assert_outcomes(passed=1)


def test_a_shared_fixture_wants_its_mark_on_every_test(
    run: Run, installed: Callable[[str], Path]
) -> None:
    installed("qemu-system-arm")
    result = run(
        """
        import subprocess, pytest

        @pytest.fixture(scope="module")
        def emulated():
            subprocess.run(["qemu-system-arm"], check=True)

        @pytest.fixture
        def through(emulated):
            pass

        @pytest.mark.needs("qemu-system-arm")
        def test_first(emulated):
            pass

        def test_second(through):
            pass
        """
    )
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["*fixture emulated starts qemu-system-arm without the mark*"])


def test_own_programs_and_the_base_need_no_mark(tmp_path: Path) -> None:
    made = tmp_path / "made"
    made.write_text("#!/bin/sh\n", encoding="ascii")
    made.chmod(0o755)
    assert [check_start(p, ()) for p in (str(made), sys.executable, "sh", "no-such")] == [None] * 4


# ---- generated files --------------------------------------------------------------------------


def test_the_files_are_fresh() -> None:
    how = "run `PYTHONPATH=tests python -m support.tools`"
    for path, system in FILES.items():
        assert path.read_text(encoding="utf-8") == packages_text(system), how
    page = CONTRIBUTING.read_text(encoding="utf-8")
    assert page == contributing_text(page), how
    assert all(f"| `{tool.name}` |" in page for tool in TOOLS)


def test_every_tool_has_a_package_and_every_program_one_tool() -> None:
    assert all(tool.packages for tool in TOOLS)
    assert len(BY_NAME) == len(TOOLS)
    assert len(PROGRAMS) == sum(len(names) for tool in TOOLS for names in tool.programs)
    with pytest.raises(UnknownToolError):
        tool_named("tsark")


def test_every_workflow_runs_commands_that_people_can_run() -> None:
    """Each workflow only calls `.ci/run`, on the system whose packages the registry lists."""
    workflows = list((ROOT / ".github" / "workflows").glob("*.yml"))
    assert len(workflows) > 1
    for path in workflows:
        text = path.read_text(encoding="utf-8")
        runs = re.findall(r"^ *- run: (.+)$", text, re.MULTILINE)
        assert [run.split()[:2] for run in runs] == [["bash", ".ci/run"]], path.name
        assert set(re.findall(r"runs-on: (\S+)", text)) == {"ubuntu-24.04"}, path.name


def test_names_of_packages_follow_the_distribution() -> None:
    clang = [tool_named("clang")]
    assert install_command(clang, "debian").split()[-1] == "libclang-rt-dev"
    assert install_command(clang, "ubuntu").split()[-1] == "libclang-rt-18-dev"
    assert install_command(clang, "").split()[-1] == "libclang-rt-dev"


def test_a_test_that_lacks_two_tools_counts_once() -> None:
    lines = block({("gcc", "tshark"): 1, ("tshark",): 4, (): 7})
    assert "not run, for want of a system tool: 5 tests" in lines
    assert [line.split()[:2] for line in lines if line.startswith("  ")] == [
        ["gcc", "1"],
        ["tshark", "5"],
    ]
    assert block({(): 3}) == []
