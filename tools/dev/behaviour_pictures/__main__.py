"""Draw the pictures of the robot's behaviour, each from a simulated run."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.view.report.drawing import as_png
from tools.cli.console import write_line
from tools.dev.behaviour_pictures.control import (
    control_drive,
    control_follow,
    control_limits,
    control_turn,
)
from tools.dev.behaviour_pictures.estimation import (
    estimation_bias,
    estimation_path,
    estimation_walls,
)
from tools.dev.behaviour_pictures.planners import (
    paper_lanes,
    recovery_bump,
    recovery_cliff,
    recovery_heading,
    recovery_occluded,
    recovery_phases,
    recovery_stuck,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure


_DPI = 90

PICTURES: dict[str, Callable[[], Figure]] = {
    "estimation-path": estimation_path,
    "estimation-walls": estimation_walls,
    "estimation-bias": estimation_bias,
    "control-drive": control_drive,
    "control-turn": control_turn,
    "control-follow": control_follow,
    "control-limits": control_limits,
    "recovery-phases": recovery_phases,
    "recovery-occluded": recovery_occluded,
    "recovery-bump": recovery_bump,
    "recovery-heading": recovery_heading,
    "recovery-cliff": recovery_cliff,
    "recovery-stuck": recovery_stuck,
    "paper-lanes": paper_lanes,
}


def main() -> int:
    """Draw the pictures."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--out", type=Path, required=True, help="Folder for the PNG files.")
    options.add_argument(
        "--only", choices=PICTURES, action="append", help="Draw only this picture; may be repeated."
    )
    given = options.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for name in given.only or PICTURES:
        path = given.out / f"{name}.png"
        path.write_bytes(as_png(PICTURES[name](), dpi=_DPI))
        write_line(f"{path}  {path.stat().st_size / 1000:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
