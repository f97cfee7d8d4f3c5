"""The firmware binaries for the supported chips, and the emulator that runs them in QEMU."""

from __future__ import annotations

import math
import signal
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from bridge.evaluation.metrics import CoverageMeter
from bridge.motion.robot_model import RobotModel
from sim_device.ports import ask_control
from support.c_build import locked, run, tool
from support.cli import decoded, end, start
from support.root import ROOT
from tools.cli.rooms import load_room

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Iterator

    from support.processes import Done

FIRMWARE = ROOT / "sim_device" / "firmware"
READY_S = 60.0
"""Maximum time to start QEMU and Python on a busy machine, s."""


def build(folder: Path) -> Path:
    """Build the programs of both boards, every warning as an error; fail if a tool is missing."""
    tool("arm-none-eabi-gcc")
    command: list[str | Path] = [
        locked("cmake"),
        "-S",
        FIRMWARE,
        "-B",
        folder,
        "-G",
        "Ninja",
        "-Wno-dev",
    ]
    toolchain = FIRMWARE / "cmake" / "cortex-m.cmake"
    ninja = f"-DCMAKE_MAKE_PROGRAM={locked('ninja')}"
    run([*command, f"-DCMAKE_TOOLCHAIN_FILE={toolchain}", ninja])
    run([locked("cmake"), "--build", folder], timeout_s=110.0)
    return folder


class Emulated(NamedTuple):
    """An emulator that has printed ``ready``."""

    process: subprocess.Popen[str]
    port: str
    control: Path

    def ask(self, line: str) -> dict[str, Any]:
        """Send a request to the control socket; the answer must be positive."""
        answer = ask_control(self.control, line)
        assert answer["ok"], answer
        return answer

    def truth(self) -> dict[str, float]:
        """Return the robot's true pose and motion."""
        truth: dict[str, float] = self.ask("truth")["truth"]
        return truth

    def qemu_pid(self) -> int:
        """Process id of QEMU, the only child process of the emulator."""
        pid = self.process.pid
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()
        assert len(children) == 1, children
        return int(children[0])


@contextmanager
def emulated(firmware: Path, cwd: Path, *arguments: str | Path) -> Iterator[Emulated]:
    """Run ``sweepctl emulate --target qemu`` during the block; it must end without an error."""
    tool("qemu-system-arm")
    control = cwd / "control"
    process = start(
        "emulate", "--target", "qemu", "--firmware", firmware, "--control", control, *arguments,
        cwd=cwd,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("ready "), process.communicate(timeout=READY_S)
        yield Emulated(process, line.removeprefix("ready ").rstrip("\n"), control)
    finally:
        if process.poll() is None:
            done = finish(process)
            assert (done.status, done.out) == (0, ""), done
            assert "Traceback" not in done.err, done.err


def finish(process: subprocess.Popen[str]) -> Done:
    """End the emulator as a user does."""
    return end(process, signal.SIGTERM)


def true_coverage(log: Path, room: str) -> float:
    """Return the swept share of the sweepable floor, from the log of the true motion."""
    poses = []
    for plain, value in decoded(log, "/truth/pose"):
        turn = value.pose.orientation
        theta = 2.0 * math.atan2(turn.z, turn.w)
        poses.append((plain.log_ns / 1e9, value.pose.position.x, value.pose.position.y, theta))
    return CoverageMeter(load_room(room), RobotModel()).measure(poses).coverage.mouth_sweepable
