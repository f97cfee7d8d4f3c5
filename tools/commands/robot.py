"""``sweepctl robot``: make, check and show robot files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from tools.cli import options
from tools.cli.completion import complete_robot
from tools.cli.console import inform, plain_console, write_json
from tools.cli.paths import PathName

if TYPE_CHECKING:
    from pathlib import Path

    from rich.table import Table

    from bridge.motion.robot_model import RobotModel


@click.group("robot", epilog="Example:  sweepctl robot check my-robot.toml")
def command() -> None:
    """Make, check and show robot files.

    A robot file is TOML; `docs/robot-file.md` lists its keys.
    """


_file = click.argument("file", type=PathName(dir_okay=False), shell_complete=complete_robot)


@command.command("new", epilog="Example:  sweepctl robot new my-robot.toml")
@click.argument("file", type=PathName(dir_okay=False))
@click.option("--force", is_flag=True, help="Replace the file if it exists.")
def new(*, file: Path, force: bool) -> int:
    """Write a robot file with each key, its default, unit, range and meaning."""
    from bridge.config import template
    from bridge.view.output import write
    from tools.cli.outputs import TOML, check_format, check_outputs

    check_format("FILE", file, *TOML)
    check_outputs([file], [], force=force)
    write(file, template().encode())
    inform(f"wrote {file}; change it, then run: sweepctl robot check {file}")
    return 0


@command.command("check", epilog="Example:  sweepctl robot check my-robot.toml --json")
@_file
@options.json_option
def check(*, file: Path, as_json: bool) -> int:
    """Report every problem of a robot file, and what will not work well.

    The exit status is 2 if the file cannot be used, else 0.
    """
    from bridge.config import load_robot, robot_cautions
    from tools.cli.findings import Findings

    findings = Findings.of(
        file, lambda: load_robot(file)[0], lambda model: tuple(robot_cautions(model))
    )
    return findings.print(as_json=as_json)


@command.command("show", epilog="Example:  sweepctl robot show my-robot.toml --png my-robot.png")
@_file
@click.option(
    "--png",
    type=PathName(dir_okay=False),
    help="Also draw the robot: footprint, mouth, wheels, sensors with their cones, and where no "
    "sensor measures what touches the hull (.png).",
)
@click.option("--force", is_flag=True, help="Replace the picture if it exists.")
@options.json_option
def show(*, file: Path, png: Path | None, force: bool, as_json: bool) -> int:
    """Show a robot's sizes, and what its sensors measure at the hull."""
    from bridge.config import load_robot, robot_cautions
    from bridge.view.output import write
    from bridge.view.setup.robot_picture import robot_picture
    from tools.cli.outputs import PNG, check_format, check_outputs

    check_format("--png", png, *PNG)
    check_outputs([png], [file], force=force)
    model, _ = load_robot(file)
    warnings = robot_cautions(model)
    facts = _facts(model)
    if png is not None:
        write(png, robot_picture(model))
    if as_json:
        write_json({**facts, "warnings": warnings, "png": str(png) if png else None})
        return 0
    plain_console().print(_table(facts))
    for text in warnings:
        inform(f"warning: {text}")
    if png is not None:
        inform(f"wrote {png}")
    return 0


def _facts(model: RobotModel) -> dict[str, Any]:
    """Return the robot's keys, and for each sensor its range at the hull."""
    import dataclasses

    from bridge.view.setup.hull import blind_share, hull_view

    facts: dict[str, Any] = dataclasses.asdict(model)
    for name, mount in model.rangers.items():
        facts[name]["hull_m"] = mount.contact_range_m(model.radius_m)
        facts[name]["reads_hull"] = mount.min_range_m <= facts[name]["hull_m"] <= mount.max_range_m
    facts["mouth_reach_m"] = model.mouth_reach_m
    facts["metres_per_count"] = model.metres_per_count
    facts["hull_blind_share"] = blind_share(hull_view(model))
    return facts


def _table(facts: dict[str, Any]) -> Table:
    from rich.table import Table
    from rich.text import Text

    from tools.cli.visible_text import one_line

    rows = [
        ("robot", one_line(facts["name"])),
        ("footprint", f"{facts['robot_diameter_m']:g} m"),
        (
            "mouth",
            (
                f"{facts['cleaning_width_m']:g} m wide, {facts['mouth_offset_m']:g} m ahead of the "
                f"axle; its ends are {facts['mouth_reach_m']:.3g} m from the axle's centre"
            ),
        ),
        (
            "wheels",
            (
                f"{facts['wheel_diameter_m']:g} m, {facts['wheel_base_m']:g} m apart, "
                f"{1000 * facts['metres_per_count']:.4f} mm for each encoder count"
            ),
        ),
        (
            "speed",
            (
                f"{facts['cruise_speed_m_s']:g} m/s usually, {facts['max_speed_m_s']:g} m/s at "
                f"most, {facts['max_accel_m_s2']:g} m/s²"
            ),
        ),
    ]
    for name in ("ultrasonic", "infrared_left", "infrared_right"):
        sensor = facts[name]
        reads = "is measured" if sensor["reads_hull"] else "is not measured"
        rows.append(
            (
                name.replace("_", " "),
                (
                    f"at ({sensor['x_m']:g}, {sensor['y_m']:g}) m, {sensor['min_range_m']:g} to "
                    f"{sensor['max_range_m']:g} m; a wall that touches the hull is "
                    f"{1000 * sensor['hull_m']:.0f} mm away and {reads}"
                ),
            )
        )
    blind = f"{100 * facts['hull_blind_share']:.0f} %"
    rows += [
        ("hull", f"no range sensor measures what touches {blind} of it"),
        ("battery", f"{facts['battery_v']:g} V, {facts['battery_ah']:g} Ah"),
    ]
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in rows:
        table.add_row(name, Text(value))
    return table
