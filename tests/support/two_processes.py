"""``sweepctl emulate`` and ``sweepctl connect`` as two processes over a real pty."""

from __future__ import annotations

import itertools
import os
import pty
import select
import signal
import subprocess
import threading
import time
import tty
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Self

from bridge.record.reader import LogReader
from support.fairly import AGAIN_S
from support.hold_up import Busy
from support.processes import COMMAND, Done, environment

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from types import TracebackType

PATIENCE_S = 60.0
"""Maximum time of a step that usually takes seconds, s; only a hang is longer."""


TURN_S = 0.05
"""Minimum time between two poses of the emulator that shows a pause of its process, s. Without a
pause, this time is at most 20 ms plus a control period.
"""


class Command:
    """A running ``sweepctl``."""

    def __init__(self, *arguments: str | Path, cwd: Path, **variables: str) -> None:
        self.process = subprocess.Popen(
            [*COMMAND, *map(str, arguments)],
            cwd=cwd,
            env=environment(PYTHONUNBUFFERED="1", **variables),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._lines: list[str] = []
        self._printed = threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            with self._printed:
                self._lines.append(line)
                self._printed.notify_all()

    def prints(self, text: str) -> None:
        """Wait until a line on stderr contains ``text``."""
        with self._printed:
            found = self._printed.wait_for(
                lambda: (
                    any(text in line for line in self._lines) or self.process.poll() is not None
                ),
                PATIENCE_S,
            )
            assert found, "".join(self._lines)
            assert any(text in line for line in self._lines), "".join(self._lines)

    @property
    def printed(self) -> str:
        """Text on stderr so far."""
        with self._printed:
            return "".join(self._lines)

    def first_line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline()

    def send(self, number: int) -> None:
        self.process.send_signal(number)

    def is_stopped(self) -> None:
        """Wait until a SIGSTOP has stopped every thread."""
        tasks = Path(f"/proc/{self.process.pid}/task")
        until_s = time.monotonic() + PATIENCE_S
        while any(_state(task) not in "TZX" for task in tasks.iterdir()):
            assert time.monotonic() < until_s, "it runs on"
            time.sleep(0.001)

    def end(self) -> Done:
        """Wait until the command ends; return its result."""
        assert self.process.stdout is not None
        assert self.process.stderr is not None
        try:
            status = self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise
        out = self.process.stdout.read()
        self._reader.join(PATIENCE_S)
        self.process.stdout.close()
        self.process.stderr.close()
        return Done(status, out, "".join(self._lines))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.send_signal(signal.SIGCONT)
        if self.process.stdout is not None and not self.process.stdout.closed:
            self.end()


def _state(task: Path) -> str:
    """Return the letter of a thread's state; X if it has ended."""
    try:
        return (task / "stat").read_text(encoding="ascii").rpartition(")")[2].split()[0]
    except OSError:
        return "X"


class Emulator(Command):
    """A virtual sweeper on its own pty."""

    def __init__(self, cwd: Path, *arguments: str | Path, **variables: str) -> None:
        options = ("emulate", "case-1", "--noise", "none", *arguments)
        super().__init__(*options, cwd=cwd, **variables)
        line = self.first_line()
        assert line.startswith("ready "), line
        self.port = line.split()[1]

    def stop(self) -> Done:
        self.send(signal.SIGTERM)
        return self.end()


def connect(cwd: Path, port: str, *arguments: str | Path) -> Done:
    """Run ``sweepctl connect`` to its end."""
    with Command("connect", port, *arguments, cwd=cwd) as command:
        return command.end()


class Pose(NamedTuple):
    """True pose of the robot; Unix time in seconds."""

    at_s: float
    x_m: float
    y_m: float
    half_yaw: float
    """Sine of half the heading."""


def truth(path: Path) -> list[Pose]:
    """Return the poses in the emulator's own log."""
    poses = []
    for message in LogReader(path).messages(["/truth/pose"]):
        pose = message.decoded.pose
        poses.append(
            Pose(message.log_ns / 1e9, pose.position.x, pose.position.y, pose.orientation.z)
        )
    return poses


def last_motion_s(poses: list[Pose]) -> float:
    """Return when the robot last moved."""
    last = -1.0
    for before, after in itertools.pairwise(poses):
        moved = abs(after.x_m - before.x_m) + abs(after.y_m - before.y_m)
        if moved > 1e-4 or abs(after.half_yaw - before.half_yaw) > 2e-4:
            last = after.at_s
    return last


def held_up_s(poses: list[Pose], from_s: float, to_s: float) -> float:
    """Return the total time for which the machine did not run the emulator in an interval.

    The emulator logs its pose in every turn, 20 ms apart or a little more. A longer gap is due to
    the machine.
    """
    inside = [p.at_s for p in poses if from_s - 1.0 < p.at_s < to_s + 1.0]
    gaps = (
        min(after, to_s) - max(before, from_s)
        for before, after in itertools.pairwise(inside)
        if after > from_s and before < to_s and after - before > TURN_S
    )
    return sum(gaps)


class PtyPeer:
    """A pty with a peer other than a sweeper."""

    def __init__(self, answer: Callable[[], bytes]) -> None:
        """``answer`` returns the bytes to write, about ten times a second."""
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._answer = answer
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while not self._end.wait(0.1):
            if select.select([self._master], [], [], 0.0)[0]:
                os.read(self._master, 65536)
            data = self._answer()
            if data:
                try:
                    os.write(self._master, data)
                except BlockingIOError:  # there is no reader
                    continue

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._end.set()
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)


def _fairly(scenario: Callable[[Path], None], folder: Path) -> None:
    """Run a scenario, and once more in a new folder if the machine was too busy."""
    busy = Busy()
    try:
        scenario(folder)
    except Exception:
        if not busy.excuses or busy.elapsed_s > AGAIN_S:
            raise
        again = folder / "again"
        again.mkdir()
        scenario(again)


class Together:
    """Runs scenarios at the same time, because they mostly wait."""

    def __init__(self, scenarios: Mapping[str, Callable[[Path], None]], folder: Path) -> None:
        self._pool = ThreadPoolExecutor(len(scenarios))
        self._futures: dict[str, Future[None]] = {}
        for name, scenario in scenarios.items():
            own = folder / name
            own.mkdir()
            self._futures[name] = self._pool.submit(_fairly, scenario, own)

    def result(self, name: str) -> None:
        """Wait for one scenario; raise its exception."""
        self._futures[name].result()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._pool.shutdown()
