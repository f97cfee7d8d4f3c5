"""The option ``--target core`` of ``simulate`` and ``emulate``."""

from __future__ import annotations

import signal
import subprocess
from contextlib import suppress
from pathlib import Path

import pytest

from support.c_build import tool
from support.cli import PATIENCE_S, end, start, sweepctl
from support.core_build import LIBRARY, library
from support.root import ROOT

pytestmark = pytest.mark.slow

CRASHING = (LIBRARY[0], ROOT / "tests" / "c" / "crashing_firmware.c")
RUN = ("simulate", "case-1", "--target", "core", "--max-time", "10", "--out", "run.mcap")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_run_on_the_core_is_deterministic() -> None:
    done = [sweepctl(*RUN, "--force", "--json") for _ in range(2)]
    assert [d.status for d in done] == [1, 1]  # the time limit ended the run
    assert done[0].json == done[1].json
    assert done[0].json["path_m"] > 0.5


def test_its_log_names_the_target() -> None:
    sweepctl(*RUN, "--json")
    assert sweepctl("info", "run.mcap", "--json").json["metadata"]["target"] == "core"


@pytest.mark.needs("addr2line")
def test_a_crash_of_the_firmware_ends_the_run_and_closes_the_log(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("BUG", "pointer")
    done = sweepctl(*RUN, "--firmware", library(*CRASHING), "--json")
    assert done.status == 1
    assert done.json["outcome"] == "fault"
    assert "crashed: SIGSEGV" in done.json["reason"]
    assert "Traceback" not in done.err
    assert len(done.err.strip().splitlines()) > 2  # the cause, and the backtrace
    info = sweepctl("info", "run.mcap", "--json").json
    assert (info["whole"], info["problems"], info["outcome"]) == (True, [], "fault")


def test_an_emulator_ends_with_its_firmware(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BUG", "exit")
    process = start("emulate", "--target", "core", "--firmware", library(*CRASHING), cwd=tmp_path)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert out.startswith("ready ")
    assert "called exit(7)" in err


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--target", "core", "--firmware", "text.so"], "text.so"),
        (["--firmware", "text.so"], "--target core"),
        (["--gdb"], "--target core"),
        (["--target", "qemu"], "real time"),
        (["--fault", "can-bus-off@1"], "not on a CAN bus"),
        (["--target", "core", "--fault", "clock-jump@1:ms=3"], "one counter"),
    ],
)
def test_options_that_do_not_fit(arguments: list[str], reason: str) -> None:
    Path("text.so").write_text("no library")
    done = sweepctl("simulate", "case-1", *arguments)
    assert (done.status, done.out) == (2, "")
    assert reason in done.err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize("command", [RUN, ("emulate", "case-1", "--target", "core")])
def test_a_signal_ends_the_wait_for_a_debugger(
    tmp_path: Path, command: tuple[str, ...], number: signal.Signals, *, own: bool
) -> None:
    firmware = ["--firmware", str(library(*LIBRARY))] if own else []
    process = start(*command, "--gdb", *firmware, cwd=tmp_path)
    try:
        assert process.stderr is not None
        assert "waiting for a debugger: gdb" in process.stderr.readline()
        process.send_signal(number)
        _, err = process.communicate(timeout=PATIENCE_S)
        assert (process.returncode, err.strip()) == (0, "sweepctl: interrupted")
    finally:
        if process.poll() is None:
            end(process, signal.SIGKILL)
            process.communicate()


@pytest.mark.needs("gdb")
@pytest.mark.parametrize("own", [False, True])
def test_it_waits_for_a_debugger(tmp_path: Path, *, own: bool) -> None:
    firmware = ["--firmware", str(library(*LIBRARY))] if own else []
    process = start(*RUN, "--gdb", *firmware, cwd=tmp_path)
    try:
        assert process.stderr is not None
        line = process.stderr.readline()
        assert "waiting for a debugger: gdb" in line
        pid = next(word for word in line.split() if word.isdigit())
        script = ["-ex", "break firmware_boot", "-ex", "continue", "-ex", "backtrace"]
        with suppress(subprocess.TimeoutExpired):
            gdb = subprocess.run(
                [tool("gdb"), "-q", "-batch", "-p", pid, *script, "-ex", "kill"],
                capture_output=True,
                text=True,
                timeout=60,
                check=False,
            )
            assert "firmware_boot" in gdb.stdout, gdb
            return
        pytest.fail("the debugger did not reach the core")
    finally:
        if process.poll() is None:
            end(process, signal.SIGKILL)
        process.communicate()
