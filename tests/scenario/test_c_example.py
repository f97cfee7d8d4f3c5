"""The example device, built as its page says, accepted by the command that users run."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from protocol.generate import render
from support.c_build import run, tool

ROOT = Path(__file__).resolve().parents[2]


def test_connect_accepts_the_example_device(tmp_path: Path) -> None:
    wire = tmp_path / "wire"
    wire.mkdir()
    for name, text in render("c").items():
        (wire / name).write_text(text)
    program = tmp_path / "device"
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic", "-Os"]
    examples = (ROOT / "examples" / name for name in ("device_main.c", "board_pty.c"))
    sources = [*examples, wire / "sweepctl_protocol.c"]
    run([tool("gcc"), *flags, f"-I{wire}", f"-I{ROOT / 'examples'}", *sources, "-o", program])
    with subprocess.Popen([program], stdout=subprocess.PIPE, text=True) as device:
        try:
            assert device.stdout is not None
            port = device.stdout.readline().removeprefix("ready ").strip()
            log = tmp_path / "run.mcap"
            done = subprocess.run(
                [
                    *(sys.executable, "-m", "tools.sweepctl", "connect", port),
                    *("--duration", "2", "--json", "--out", str(log)),
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
    assert "both ends agree" in done.stderr
