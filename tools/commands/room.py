"""``sweepctl room``: check, show and import rooms."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from tools.cli import options
from tools.cli.completion import complete_room
from tools.cli.console import inform, plain_console, write_json
from tools.cli.paths import PathName

if TYPE_CHECKING:
    from bridge.evaluation.room_facts import RoomFacts
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel


@click.group("room", epilog="Example:  sweepctl room show case-1 --png case-1.png")
def command() -> None:
    """Check, show and import rooms.

    A room file is JSON; `docs/rooms.md` lists its keys.
    """


_room = click.argument("room", shell_complete=complete_room)


@command.command("check", epilog="Example:  sweepctl room check my-room.json")
@_room
@options.robot_option
@options.start_option
@options.json_option
def check(*, room: str, robot: Path | None, start: Pose2 | None, as_json: bool) -> int:
    """Report every problem of ROOM, and what is probably wrong in it.

    ROOM is a room file or a name (`docs/rooms.md`). The exit status is 2 if the room cannot be
    used with the robot, else 0.
    """
    from bridge.config import load_robot
    from tools.cli.findings import Findings
    from tools.cli.rooms import load_room

    model, _ = load_robot(robot)
    findings = Findings.of(
        room, lambda: load_room(room, model.radius_m, start), lambda plan: _warnings(plan, model)
    )
    return findings.print(as_json=as_json)


def _warnings(plan: FloorPlan, model: RobotModel, facts: RoomFacts | None = None) -> list[str]:
    """Return the probable mistakes in a room for a robot."""
    from bridge.evaluation.room_facts import room_facts
    from bridge.floor_plan.inspection import plan_cautions

    facts = facts or room_facts(plan, model)
    found = [*plan.cautions, *plan_cautions(plan)]
    found += [
        f"the robot fits at ({piece.x_m:.2f}, {piece.y_m:.2f}) and cannot get there from the "
        f"start; {piece.area_m2:.2f} m² are cut off"
        for piece in facts.separate[:_MAX_PIECES]
    ]
    if len(facts.separate) > _MAX_PIECES:
        found.append(f"{len(facts.separate) - _MAX_PIECES} more places are cut off")
    return found


_MAX_PIECES = 5
"""Maximum number of unreachable places that are named."""


@command.command("show", epilog="Example:  sweepctl room show case-1 --png case-1.png")
@_room
@options.robot_option
@options.start_option
@click.option(
    "--png",
    type=PathName(dir_okay=False),
    help="Also draw the room: free, reachable and sweepable floor, obstacles, carpets, thresholds "
    "and cliffs (.png).",
)
@click.option("--force", is_flag=True, help="Replace the picture if it exists.")
@options.json_option
def show(  # noqa: PLR0913 - one parameter per option
    *,
    room: str,
    robot: Path | None,
    start: Pose2 | None,
    png: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Show the size of ROOM, and how much of its floor a robot reaches and sweeps."""
    from bridge.config import load_robot
    from bridge.evaluation.room_facts import room_facts
    from bridge.view.output import write
    from bridge.view.setup.room_picture import room_picture
    from tools.cli.outputs import PNG, check_format, check_outputs
    from tools.cli.rooms import load_room

    check_format("--png", png, *PNG)
    check_outputs([png], [Path(room)], force=force)
    model, _ = load_robot(robot)
    plan = load_room(room, model.radius_m, start)
    facts = room_facts(plan, model)
    warnings = _warnings(plan, model, facts)
    if png is not None:
        write(png, room_picture(plan, model, facts))
    rows = _rows(plan, facts)
    if as_json:
        values = {name: value for name, _, value in rows}
        write_json({**values, "warnings": warnings, "png": str(png) if png else None})
        return 0
    _print_rows([(name.removesuffix("_m2").removesuffix("_m"), text) for name, text, _ in rows])
    for text in warnings:
        inform(f"warning: {text}")
    if png is not None:
        inform(f"wrote {png}")
    return 0


def _rows(plan: FloorPlan, facts: RoomFacts) -> list[tuple[str, str, object]]:
    """Return the room's properties: name, text and value."""
    x0, y0, x1, y1 = plan.bounds()
    size = [round(x1 - x0, 3), round(y1 - y0, 3)]

    def part(area_m2: float) -> str:
        return f"{area_m2:.2f} m², {100.0 * area_m2 / max(facts.free_m2, 1e-9):.1f} % of it"

    counts = {
        name: len(getattr(plan, name)) for name in ("obstacles", "carpets", "thresholds", "cliffs")
    }
    x_m, y_m, theta_rad = plan.start
    return [
        ("room", plan.name, plan.name),
        ("size_m", f"{size[0]:g} m × {size[1]:g} m", size),
        ("start", f"({x_m:g}, {y_m:g}) m, heading {theta_rad:.4g} rad", list(plan.start)),
        *((name, str(count), count) for name, count in counts.items()),
        ("free_m2", f"{facts.free_m2:.2f} m²", facts.free_m2),
        ("reachable_m2", part(facts.reachable_m2), facts.reachable_m2),
        ("sweepable_m2", part(facts.sweepable_m2), facts.sweepable_m2),
    ]


def _print_rows(rows: list[tuple[str, str]]) -> None:
    from rich.table import Table
    from rich.text import Text

    from tools.cli.visible_text import one_line

    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in rows:
        table.add_row(name, Text(one_line(value)))
    plain_console().print(table)


@command.command(
    "import", epilog="Example:  sweepctl room import map.yaml --out flat.json --start 1.5,0.4,90"
)
@click.argument("file", type=PathName(dir_okay=False))
@click.option(
    "--out",
    type=PathName(dir_okay=False),
    required=True,
    help="Room file to write (.json).",
)
@click.option(
    "--scale",
    "scale_m",
    type=options.Number(1e-6, 1000.0),
    metavar="M",
    help="With an SVG: length of one of its units, in metres (0.01: a unit is a centimetre).",
)
@click.option(
    "--tolerance",
    "tolerance_m",
    type=options.Number(0.0, 1.0),
    metavar="M",
    help="Leave out corners that are within M metres of a straight outline.  [default: 0.75 cells "
    "of a ROS map, 0.01 for an SVG]",
)
@options.robot_option
@options.start_option
@click.option("--force", is_flag=True, help="Replace the room file if it exists.")
@options.json_option
def import_(  # noqa: PLR0913 - one parameter per option
    *,
    file: Path,
    out: Path,
    scale_m: float | None,
    tolerance_m: float | None,
    robot: Path | None,
    start: Pose2 | None,
    force: bool,
    as_json: bool,
) -> int:
    """Make a room file from a ROS map or an SVG floor plan.

    A ROS map is the .yaml file of map_server beside its image, in mode trinary; unknown cells are
    no floor. The room is the largest connected free floor, or the piece with --start.

    In an SVG, words in the id, class or label of a shape or its group tell what it is: wall,
    obstacle, furniture, carpet, rug, threshold, cliff, stair, staircase, start (or their plurals).
    A shape's own word counts before its group's. A shape named room is the walls, too. Without
    words the largest shape is the walls, and the others are obstacles.
    """
    from bridge.config import load_robot
    from bridge.convert.map_import import import_map
    from bridge.floor_plan.floor_plan import parse_floorplan
    from bridge.view.output import write
    from tools.cli.findings import Findings
    from tools.cli.outputs import JSON, check_format, check_outputs

    check_format("--out", out, *JSON)
    check_outputs([out], [file], force=force)
    if file.suffix.lower() == ".svg" and scale_m is None:
        raise click.UsageError(f"{file}: an SVG needs --scale, the length of one unit in metres")
    model, _ = load_robot(robot)
    text = import_map(file, scale_m=scale_m, tolerance_m=tolerance_m, start=start).to_json()
    findings = Findings.of(
        out,
        lambda: parse_floorplan(text, default_name=out.stem, radius_m=model.radius_m),
        lambda plan: _warnings(plan, model),
    )
    if not findings.problems:
        write(out, f"{text}\n".encode())
    return findings.print(as_json=as_json)
