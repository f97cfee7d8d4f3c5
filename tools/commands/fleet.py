"""``sweepctl fleet``: several robots at once."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from tools.cli import options, planners
from tools.cli.completion import complete_robot, complete_room
from tools.cli.configuration import configuration, robots_of
from tools.cli.on_event import on_option
from tools.cli.paths import PathName
from tools.cli.port_options import complete_port

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tools.cli.configuration import Named
    from tools.fleet.dashboard import FleetDashboard
    from tools.fleet.fleet import Fleet
    from tools.fleet.member import Target

_PORT_OPTIONS = ("baud", "bitrate")


@click.command(
    "fleet", epilog="Example:  sweepctl fleet /dev/ttyUSB0 /dev/ttyUSB1 --supervise --duration 3600"
)
@click.argument(
    "robots",
    metavar="PORT...",
    nargs=-1,
    required=True,
    callback=robots_of,
    shell_complete=complete_port,
)
@options.plan_options
@options.duration_option
@click.option(
    "--room",
    shell_complete=complete_room,
    help="Room file or name of a room, the same for all robots. Each summary then has the "
    "coverage.",
)
@click.option(
    "--robot",
    type=PathName(dir_okay=False),
    shell_complete=complete_robot,
    help="Robot file (TOML) for robots without one in the configuration file.",
)
@on_option
@click.option(
    "--out",
    type=PathName(file_okay=False),
    help="Folder for the logs, NAME.mcap each.  [default: runs/<UTC>-<NAME>.mcap]",
)
@options.json_option
def command(  # noqa: PLR0913 - one parameter per option
    *,
    robots: tuple[Named, ...],
    planner: str | None,
    supervise: bool,
    onboard: str | None,
    duration_s: float | None,
    room: str | None,
    robot: Path | None,
    on_events: tuple[tuple[str, str], ...],
    out: Path | None,
    as_json: bool,
) -> int:
    """Connect to several robots, show them on one dashboard, and record a log of each.

    PORT is a port or the name of a robot in a configuration file. Each robot has its own
    process, so a failure of one does not affect the others. Options apply to each robot. Space
    stops all robots and waits for their confirmations. Robots that do not confirm in time are
    listed. The robots move only with --plan or --supervise.

    Exit status: the most severe status of `connect` among all robots; 3 if a robot did not confirm
    a stop.
    """
    if supervise and planner is not None:
        raise click.UsageError("give --plan or --supervise, not both")
    if onboard is not None and not supervise:
        raise click.UsageError("--onboard needs --supervise")
    _check_files(robots, robot, room, planner)
    arguments: list[str] = []
    if planner is not None:
        arguments += ["--plan", planner]
    if supervise:
        arguments += ["--supervise", "--onboard", onboard or planners.DEFAULT_PLANNER]
    if duration_s is not None:
        arguments += ["--duration", str(duration_s)]
    if room is not None:
        arguments += ["--room", room]
    for event, line in on_events:
        arguments += ["--on", event, line]
    return _run(_targets(robots, out, robot), arguments, as_json=as_json)


def _check_files(
    robots: Sequence[Named], robot: Path | None, room: str | None, planner: str | None
) -> None:
    """Read every robot file, the room and the planner before a process starts.

    Raises:
        BridgeError: a file, the room or the planner is invalid; the text names it.

    """
    import random

    from bridge.config import load_robot
    from tools.cli.rooms import load_room

    default = configuration(click.get_current_context()).defaults.get("robot")
    if robot is None and default is not None:
        robot = Path(str(default.value))
    for named in robots:
        own = named.values.get("robot")
        model, _ = load_robot(robot if own is None else Path(str(own.value)))
        if room is not None:
            load_room(room, model.radius_m)
        if planner is not None:
            planners.make(planner, model, random.Random(0), option="--plan")


def _targets(robots: Sequence[Named], out: Path | None, robot: Path | None) -> list[Target]:
    """Give each robot a label and a log.

    Raises:
        click.UsageError: a port is given twice.
        OutputExistsError: a log exists.

    """
    from bridge.errors import OutputExistsError
    from tools.cli.paths import is_there
    from tools.fleet.member import Target

    targets: list[Target] = []
    for named in robots:
        if any(each.port == named.port for each in targets):
            raise click.UsageError(f"the port {named.port} is given twice")
        label = named.given
        name = label if named.values else Path(named.port).name
        log = options.log_path(None, name) if out is None else out / f"{_file_name(label)}.mcap"
        if out is not None and is_there(log):
            raise OutputExistsError(log)
        how = {key: named.values[key].value for key in _PORT_OPTIONS if key in named.values}
        node = named.values.get("node")
        own = ("--robot", str(robot)) if robot is not None and "robot" not in named.values else ()
        targets.append(
            Target(
                label,
                named.given,
                named.port,
                None if node is None else int(node.value),
                how,
                _unique(log, [each.log for each in targets]),
                own,
            )
        )
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    return targets


def _file_name(label: str) -> str:
    return "".join(c if c.isalnum() or c in "-_." else "-" for c in label).strip("-.") or "robot"


def _unique(log: Path, taken: Sequence[Path]) -> Path:
    number, made = 2, log
    while made in taken:
        made = log.with_name(f"{log.stem}-{number}{log.suffix}")
        number += 1
    return made


def _drive(fleet: Fleet, board: FleetDashboard | None) -> None:
    """Run the fleet to its end. After any error the robots stop, and their processes end."""
    try:
        fleet.start()
        if board is not None:
            board.fleet = fleet
            board.start()
        _wait(fleet)
    except BaseException:
        fleet.end()
        _wait(fleet)
        raise
    finally:
        if board is not None:
            board.stop()


def _run(targets: Sequence[Target], arguments: Sequence[str], *, as_json: bool) -> int:
    from tools.cli.console import inform, is_drawable, print_error, write_json
    from tools.cli.interrupt import set_done
    from tools.cli.signals import until_signalled
    from tools.cli.visible_text import one_line
    from tools.fleet.dashboard import FleetDashboard
    from tools.fleet.fleet import Fleet
    from tools.live.terminal_keys import Key, Keyboard

    drawn = is_drawable()
    board = FleetDashboard(has_keys=Keyboard.possible()) if drawn else None
    fleet = Fleet(targets, arguments, board.line if board else _print_line)

    def on_key(key: Key) -> None:
        if key.kind == "press" and key.name in {"space", "s"}:
            fleet.stop()

    with until_signalled(fleet.end), Keyboard(on_key, releases=False):
        _drive(fleet, board)
    if as_json:
        write_json(fleet.to_dict())
        set_done()
    for member in fleet.members:
        ended = member.ended
        if ended is None or (board is None and one_line(ended.reason) == member.last_error):
            continue
        inform(f"{member.target.label}: {ended.outcome} - {ended.reason}")
    if fleet.stop_requested and not fleet.unconfirmed:
        inform("every robot has confirmed the stop")
    for label in fleet.unconfirmed:
        print_error(f"{label}: the stop is NOT CONFIRMED; switch the robot off")
    return fleet.exit_status


def _print_line(label: str, line: str, *, is_error: bool) -> None:
    from tools.cli.console import inform, print_error

    (print_error if is_error else inform)(f"{label}: {line}")


def _wait(fleet: Fleet) -> None:
    from bridge.io import clock

    while not fleet.done:
        clock.pause(0.05)
