"""``sweepctl connect``: a live run with a robot."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tools.cli import options, planners
from tools.cli.adapter_delay import adapter_delay_option
from tools.cli.completion import complete_room
from tools.cli.console import print_error, print_summary
from tools.cli.foxglove import foxglove_option
from tools.cli.on_event import on_option
from tools.cli.port_options import port_argument
from tools.cli.recording import (
    check_unrecorded,
    no_record_option,
    recording_options,
    take_record_options,
    viewing_options,
)
from tools.cli.supervising import rule_option

if TYPE_CHECKING:
    from bridge.motion.geometry import Pose2


@click.command(
    "connect",
    epilog="Example:  sweepctl connect /dev/ttyUSB0 --plan paper --out clean.mcap",
)
@port_argument
@options.plan_options
@rule_option
@options.duration_option
@click.option(
    "--room",
    shell_complete=complete_room,
    help="Room file or name of a room; adds coverage and a map.",
)
@options.port_options
@adapter_delay_option
@click.option(
    "--clear-stop",
    is_flag=True,
    help="With --plan or --supervise: clear a latched safety stop first. Look at the robot before "
    "you do.",
)
@click.option(
    "--resume",
    type=click.Choice(["ask", "never"]),
    help="With --plan, after the device was lost and is back: wait 30 s for the key r to resume, "
    "or end the run.  [default: ask on a terminal, else never]",
)
@click.option(
    "--quiet",
    is_flag=True,
    help="Without a terminal: print events only, no line with the state every 5 s.",
)
@viewing_options
@foxglove_option
@on_option
@recording_options
@no_record_option
@options.key_option
@options.robot_option
@options.start_option
@options.out_option
@options.json_option
def command(  # noqa: PLR0913 - one parameter per option
    *,
    port: str,
    planner: str | None,
    supervise: bool,
    onboard: str | None,
    rules: tuple[str, ...],
    duration_s: float | None,
    room: str | None,
    node: int | None,
    adapter_delay_ns: tuple[int, int],
    clear_stop: bool,
    resume: str | None,
    key_file: Path | None,
    view: bool,
    serve: bool,
    quiet: bool,
    foxglove: tuple[str, int] | None,
    on_events: tuple[tuple[str, str], ...],
    robot: Path | None,
    start: Pose2 | None,
    out: Path | None,
    force: bool,
    no_record: bool,
    as_json: bool,
    **opening: Any,  # noqa: ANN401 - options of the port and of the recording, declared above
) -> int:
    """Connect to the robot on PORT, show it and record it (--no-record: only show it).

    The robot moves only with --plan or --supervise, or after a key of the dashboard that must be
    pressed twice.

    PORT is a device path, socket://HOST:PORT, rfc2217://HOST:PORT, or can:INTERFACE:CHANNEL for a
    CAN bus (can:slcan:/dev/ttyACM0, can:socketcan:can0, can:udp_multicast:239.74.163.2).
    """
    import random

    from bridge.api.robot_parts import planner_number
    from bridge.config import load_robot, load_supervise
    from bridge.io.reopening import PortOptions
    from bridge.run.mission import Resume
    from tools.cli.keyfile import read_key
    from tools.cli.rooms import load_room
    from tools.cli.supervising import supervise_rules
    from tools.live.run import LiveOptions, run_live

    moves = supervise or planner is not None
    if supervise and planner is not None:
        raise click.UsageError(
            "give --plan (planner on the host) or --supervise (planner on the device), not both"
        )
    for problem, holds in (
        ("--clear-stop needs --plan or --supervise", clear_stop and not moves),
        ("--supervise-rule needs --plan or --supervise", rules and not moves),
        ("--onboard needs --supervise", onboard is not None and not supervise),
        ("--resume needs --plan", resume is not None and planner is None),
    ):
        if holds:
            raise click.UsageError(problem)
    recording = take_record_options(opening)
    check_unrecorded(
        no_record, out, recording, force=force, views=view or serve or foxglove is not None
    )
    model, robot_toml = load_robot(robot)
    if start is not None and not room:
        raise click.UsageError("--start needs --room")
    plan = load_room(room, model.radius_m, start) if room else None
    if planner is not None:  # its interface is checked before the port is opened
        planners.make(planner, model, random.Random(0), option="--plan")
    if resume is None:
        resume = "ask" if sys.stdin.isatty() else "never"
    name = plan.name if plan else Path(port).name
    result = run_live(
        LiveOptions(
            port=port,
            log=None if no_record else options.log_path(out, name),
            model=model,
            robot_toml=robot_toml,
            plan=plan,
            planner=planner,
            onboard=planner_number(onboard or planners.DEFAULT_PLANNER) if supervise else None,
            supervise=supervise_rules(robot, rules) if supervise or rules else None,
            resume=Resume(resume),
            duration_s=duration_s,
            node=node,
            recording=recording,
            view=view,
            serve=serve,
            quiet=quiet,
            foxglove=foxglove,
            on_events=on_events,
            battery=load_supervise(robot).battery,
            opening=PortOptions(**opening),
            key=read_key(key_file),
            adapter_delay_ns=adapter_delay_ns,
            clear_stop=clear_stop,
            force=force,
            robot_file=robot is not None,
        )
    )
    for line in result.complaints:
        print_error(line)
    if as_json or result.negotiated or not result.complaints:
        print_summary(result.summary, as_json=as_json)
    return result.exit_status
