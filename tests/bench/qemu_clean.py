"""A complete clean by the firmware's binary in QEMU, in real time, measured by the plant's truth.

PYTHONPATH=tests python -m bench.qemu_clean [ROOM] [--planner recovery] [--seed 0]

It starts two processes as a user does: ``emulate --target qemu`` and ``connect --plan``. Case 1
takes about four minutes. The two processes need a free core. On a busy computer, the link may be
silent for too long, and the host then stops the robot.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from sim_device.ports import ask_control
from support.qemu import true_coverage

COMMAND = [sys.executable, "-m", "tools.sweepctl"]
LIMIT_S = 2400.0


def main() -> None:
    """Clean, measure and print; exit with 1 unless the room was finished."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("room", nargs="?", default="case-1")
    options.add_argument("--planner", default="recovery")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--noise", default="typical")
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        summary, counted = clean(folder, chosen)
        coverage = true_coverage(folder / "truth.mcap", chosen.room)
    print(f"outcome     {summary['outcome']} ({summary['reason']})")
    print(f"duration    {summary['duration_s']:.0f} s, path {summary['path_m']:.1f} m")
    print(f"coverage    {100 * coverage:.2f} % of the sweepable floor, by the plant's truth")
    print(f"collisions  {counted['collisions']}, in contact {counted['contact_s']:.1f} s")
    wire = summary["wire"]
    print(f"wire        {wire['frames']}, {wire['lost']} lost, {wire['crc_errors']} damaged")
    raise SystemExit(summary["outcome"] != "complete")


def clean(folder: Path, chosen: argparse.Namespace) -> tuple[dict[str, Any], dict[str, Any]]:
    """Run both processes; return the host's summary and the plant's final counts."""
    control, truth = folder / "control", folder / "truth.mcap"
    emulate = [*COMMAND, "emulate", chosen.room, "--target", "qemu", "--seed", str(chosen.seed)]
    emulate += ["--noise", chosen.noise, "--truth", str(truth), "--control", str(control)]
    with subprocess.Popen(emulate, stdout=subprocess.PIPE, text=True) as device:
        try:
            assert device.stdout is not None
            port = device.stdout.readline().removeprefix("ready ").rstrip("\n")
            connect = [*COMMAND, "connect", port, "--plan", chosen.planner, "--json"]
            connect += ["--out", str(folder / "run.mcap")]
            done = subprocess.run(
                connect, stdout=subprocess.PIPE, text=True, check=False, timeout=LIMIT_S
            )
            counted = ask_control(control, "truth")["truth"]
        finally:
            device.send_signal(signal.SIGTERM)
    if not done.stdout:
        raise SystemExit(f"connect ended with status {done.returncode}")
    return json.loads(done.stdout), counted


if __name__ == "__main__":
    main()
