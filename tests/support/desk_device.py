"""Checks a program that emulates a device: it prints `ready PORT` and serves a pseudo-terminal."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import TYPE_CHECKING

from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path


def check_that_connect_accepts(program: Path, folder: Path) -> None:
    """Run ``connect`` on ``program`` for 2 s: the handshake succeeds without a damaged frame."""
    with subprocess.Popen([program], stdout=subprocess.PIPE, text=True) as device:
        try:
            assert device.stdout is not None
            port = device.stdout.readline().removeprefix("ready ").strip()
            done = subprocess.run(
                [
                    *(sys.executable, "-m", "tools.sweepctl", "connect", port, "--duration", "2"),
                    *("--json", "--out", str(folder / "run.mcap")),
                ],
                cwd=ROOT,
                capture_output=True,
                text=True,
                check=False,
            )
        finally:
            device.terminate()
    assert device.returncode == 0
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["outcome"] == "stopped"
    assert summary["wire"]["crc_errors"] == 0
    assert summary["wire"]["frames"]["rx"] > 150
    assert "host and device are compatible" in done.stderr
