"""``make demo``: a simulated run in the paper's case 1, then a live run over a pty."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from rich.text import Text

from tools.cli.console import plain_console, summary_table

RUNS = Path("runs")
LIVE_S = 20
_OUT = plain_console()
_OUT.width = max(100, _OUT.width)


def main() -> int:
    """Run both parts; return 0 if both succeeded."""
    RUNS.mkdir(exist_ok=True)
    status = simulated()
    return status or live()


def simulated() -> int:
    """Run case 1 with the default planner and the whole stack in virtual time."""
    log = RUNS / "demo-simulated.mcap"
    _OUT.rule(Text("1  simulate: the paper's case 1, whole stack in virtual time", "bold"))
    done = _sweepctl(
        "simulate", "case-1", "--planner", "recovery", "--seed", "1", "--json",
        "--out", str(log), "--force",
    )  # fmt: skip
    if done.returncode:
        return done.returncode
    _OUT.print(summary_table(json.loads(done.stdout)))
    _picture(log)
    _where(log)
    return 0


def live() -> int:
    """Run an emulated robot and the host as two processes on a pseudo-terminal."""
    log = RUNS / "demo-live.mcap"
    title = f"2  emulate + connect --plan: two processes, a real wire, {LIVE_S} s"
    _OUT.rule(Text(title, "bold"))
    emulator = subprocess.Popen(
        [sys.executable, "-m", "tools.sweepctl", "emulate", "case-1", "--seed", "1"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert emulator.stdout is not None  # noqa: S101 - asked for above
        port = emulator.stdout.readline().removeprefix("ready ").strip()
        if not port:
            _OUT.print("the emulator did not start", style="red")
            return 1
        done = _sweepctl(
            "connect", port, "--plan", "paper", "--room", "case-1",
            "--duration", str(LIVE_S), "--json", "--out", str(log), "--force",
        )  # fmt: skip
    finally:
        emulator.send_signal(signal.SIGTERM)
        emulator_status = emulator.wait(timeout=10)
    if done.returncode or emulator_status:
        ends = f"connect ended with {done.returncode}, emulate with {emulator_status}"
        _OUT.print(ends, style="red")
        return done.returncode or emulator_status
    _OUT.print(summary_table(json.loads(done.stdout)))
    _picture(log)
    _where(log)
    return 0


def _sweepctl(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command as a user would, and print its messages as they arrive."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    command: list[Any] = [sys.executable, "-m", "tools.sweepctl", *arguments]
    return subprocess.run(  # noqa: S603 - our own command
        command, stdout=subprocess.PIPE, text=True, check=False, env=environment
    )


def _picture(log: Path) -> None:
    from bridge.view.report.picture import draw_run

    _OUT.print(f"picture  {draw_run(log, log.with_suffix('.png'))}")


def _where(log: Path) -> None:
    _OUT.print(f"see it   .venv/bin/sweepctl view {log}\n")


if __name__ == "__main__":
    sys.exit(main())
