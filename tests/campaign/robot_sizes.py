"""Robot files of other sizes, for ``sweepctl experiment compare --robots``.

    PYTHONPATH=tests python -m campaign.robot_sizes FOLDER

Each file is the paper's robot to scale. The mouth differs, and the infrared sensors are moved so
that they measure from the hull on; those of the robot ``blind`` are blind within 6 mm of it.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path

from bridge.config import to_toml
from bridge.motion.robot_model import RobotModel

PAPER = RobotModel()
BLIND_M = 0.006
"""Largest gap to a wall that the infrared sensors of the robot ``blind`` cannot measure, m."""
INSIDE_M = 0.05
"""Distance of an infrared sensor from the hull along its beam; its minimum range is 4 cm."""

SIZES = {
    "small": (0.20, 0.10, 0.0),
    "large": (0.40, 0.20, 0.0),
    "largest": (0.50, 0.25, 0.0),
    "narrow": (0.32, 0.096, 0.0),
    "wide": (0.32, 0.288, 0.0),
    "ahead": (0.33, 0.18, 0.10),
    "far-ahead": (0.32, 0.16, 0.128),
    "blind": (0.22, 0.10, 0.0),
}
"""Diameter, width of the mouth and its distance ahead of the axle, in m."""


def robot_of_size(name: str) -> RobotModel:
    """Return the robot of this name of ``SIZES``."""
    diameter_m, width_m, ahead_m = SIZES[name]
    scale = diameter_m / PAPER.robot_diameter_m
    x_m, y_m = scale * PAPER.infrared_left.x_m, scale * PAPER.infrared_left.y_m
    if name == "blind":
        y_m = 0.5 * diameter_m - PAPER.infrared_left.min_range_m + BLIND_M
    else:
        y_m = math.sqrt((0.5 * diameter_m) ** 2 - x_m**2) - INSIDE_M
    return replace(
        PAPER,
        name=name,
        robot_diameter_m=diameter_m,
        cleaning_width_m=width_m,
        mouth_offset_m=ahead_m,
        wheel_base_m=scale * PAPER.wheel_base_m,
        ultrasonic=replace(PAPER.ultrasonic, x_m=scale * PAPER.ultrasonic.x_m),
        infrared_left=replace(PAPER.infrared_left, x_m=x_m, y_m=y_m),
        infrared_right=replace(PAPER.infrared_right, x_m=x_m, y_m=-y_m),
    )


def main() -> int:
    """Write the files and print their names, separated by commas, as ``--robots`` takes them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    folder: Path = parser.parse_args().folder
    files = [folder / f"{name}.toml" for name in SIZES]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file in files:
            file.write_text(to_toml(robot_of_size(file.stem)), encoding="utf-8")
    except OSError as error:
        parser.error(f"cannot write {error.filename}: {error.strerror}")
    print(",".join(map(str, files)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
