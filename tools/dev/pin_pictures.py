"""Pictures of the pins of the firmware's boards for docs/, drawn from the headers of the firmware.

    .venv/bin/python -m tools.dev.pin_pictures --out docs/images

Needs the extra ``plot``.
"""

from __future__ import annotations

import argparse
import re
import sys
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from bridge.view.report.drawing import as_png, blank
from tools.cli.console import write_line

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.figure import Figure

FIRMWARE = Path(__file__).resolve().parents[2] / "sim_device" / "firmware"
BOARDS = {"pins-f429": "board_f429", "pins-nucleo-f429zi": "board_nucleo_f429zi"}
"""Folder of the board by the name of the picture."""
TITLES = {"pins-f429": "STM32F429IGT6", "pins-nucleo-f429zi": "NUCLEO-F429ZI (pin, connector)"}
_ROW_IN, _WIDTH_IN = 0.2, 7.4
"""Height of a row and width of the picture, inches."""
_COLOURS = ("#dbe9f6", "#e8f1dc", "#fdebd0", "#f3e0ec", "#e2e2f5", "#dff3f0")


class Wire(NamedTuple):
    """One connection between a part and a pin."""

    part: str
    signal: str
    pin: str
    """For example PE9."""


FIXED = (
    Wire("L298N, left motor", "IN1", "PE9"),
    Wire("L298N, left motor", "IN2", "PE11"),
    Wire("L298N, left motor", "ENA, 10 kΩ to ground", "PE8"),
    Wire("L298N, right motor", "IN3", "PE13"),
    Wire("L298N, right motor", "IN4", "PE14"),
    Wire("L298N, right motor", "ENB, 10 kΩ to ground", "PE10"),
    Wire("MPU6050", "INT", "PB5"),
    Wire("HC-SR04", "trigger", "PA4"),
    Wire("HC-SR04", "echo, divided to 3.3 V", "PA0"),
    Wire("cliff sensors", "left", "PF0"),
    Wire("cliff sensors", "middle", "PF1"),
    Wire("cliff sensors", "right", "PF2"),
    Wire("bumper", "left, to ground", "PF3"),
    Wire("bumper", "right, to ground", "PF4"),
)
"""Connections that every board has, from ``f429.h``."""
_NAMED = {
    "ENCODER_LEFT_A": ("left encoder", "A"),
    "ENCODER_LEFT_B": ("left encoder", "B"),
    "ENCODER_RIGHT_A": ("right encoder", "A"),
    "ENCODER_RIGHT_B": ("right encoder", "B"),
    "IMU_SCL": ("MPU6050", "SCL"),
    "IMU_SDA": ("MPU6050", "SDA"),
    "LINK_TX": ("serial link", "TX, to RX of the computer"),
    "LINK_RX": ("serial link", "RX, from TX of the computer"),
    "CAN_TX": ("CAN transceiver", "TXD"),
    "CAN_RX": ("CAN transceiver", "RXD"),
    "CAN_SELECT": ("CAN transceiver", "to ground: CAN, no serial link"),
}
"""Part and signal of each macro of ``board_config.h``."""
_ANALOG = (
    ("infrared sensors", "left"),
    ("infrared sensors", "right"),
    ("supply", "battery, divided by 6"),
    ("supply", "5 V rail, divided by 2"),
    ("motor currents", "left, 1 V/A"),
    ("motor currents", "right, 1 V/A"),
)
"""Part and signal of each entry of ``ANALOG_INPUTS``."""
ORDER = (
    "L298N, left motor",
    "L298N, right motor",
    "motor currents",
    "left encoder",
    "right encoder",
    "MPU6050",
    "HC-SR04",
    "infrared sensors",
    "cliff sensors",
    "bumper",
    "supply",
    "serial link",
    "CAN transceiver",
)


def wires(board: str) -> list[Wire]:
    """Return the connections of a board, in the order of the picture."""
    text = (FIRMWARE / board / "board_config.h").read_text("utf-8")
    found = [
        Wire(*_NAMED[name], f"P{port}{number}")
        for name, port, number in re.findall(
            r"^#define (\w+) PORT_([A-G]), (\d+)", text, re.MULTILINE
        )
    ]
    analog = re.findall(r"\{PORT_([A-G]), (\d+), \d+\}", text)
    found += [
        Wire(*named, f"P{port}{number}")
        for named, (port, number) in zip(_ANALOG, analog, strict=True)
    ]
    return sorted([*FIXED, *found], key=lambda wire: ORDER.index(wire.part))


def connectors(board: str) -> dict[str, str]:
    """Return the connector of each pin, from the table in the board's README; else {}.

    The third column holds the connectors. For pins that are connected on the board, it says to
    what: ``ST-LINK``.
    """
    page = FIRMWARE / board / "README.md"
    rows = page.read_text("utf-8").splitlines() if page.exists() else []
    found: dict[str, str] = {}
    for row in rows:
        cells = row.split("|")
        pins = re.findall(r"\bP[A-G]\d+\b", cells[2]) if len(cells) > 3 else []  # noqa: PLR2004 - three columns
        names = re.findall(r"\b[AD]\d+\b", cells[3]) if pins else []
        if pins and not names:
            names = [cells[3].strip()] * len(pins)
        found |= dict(zip(pins, names, strict=True))
    return found


def draw(title: str, connected: Sequence[Wire], names: Mapping[str, str]) -> Figure:
    """Draw one row for each connection: part, signal, pin."""
    figure = blank(_WIDTH_IN, _ROW_IN * (len(connected) + 2))
    axes = figure.add_subplot()
    axes.set_axis_off()
    axes.set(xlim=(0.0, 10.0), ylim=(len(connected) + 0.5, -1.5))
    axes.text(8.0, -1.0, title, ha="center", va="center", weight="bold", size=9)
    axes.fill_between((6.9, 9.9), -0.55, len(connected) - 0.45, color="#3a3a3a", alpha=0.12)
    row = 0
    for number, (part, group) in enumerate(groupby(connected, key=lambda wire: wire.part)):
        rows = list(group)
        colour = _COLOURS[number % len(_COLOURS)]
        axes.fill_between((0.1, 5.4), row - 0.45, row + len(rows) - 0.55, color=colour)
        axes.text(0.25, row + 0.5 * (len(rows) - 1), part, va="center", size=8.5, weight="bold")
        for wire in rows:
            axes.text(5.3, row, wire.signal, ha="right", va="center", size=8)
            axes.plot((5.4, 6.9), (row, row), color="#555555", linewidth=0.8)
            axes.text(7.1, row, wire.pin, va="center", size=8, family="monospace")
            axes.text(8.6, row, names.get(wire.pin, ""), va="center", size=8, family="monospace")
            row += 1
    return figure


def main(arguments: list[str]) -> int:
    """Draw the pictures."""
    parser = argparse.ArgumentParser(prog="tools.dev.pin_pictures", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the pictures")
    out = parser.parse_args(arguments).out
    for name, board in BOARDS.items():
        path = out / f"{name}.png"
        path.write_bytes(as_png(draw(TITLES[name], wires(board), connectors(board)), dpi=110))
        write_line(str(path))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
