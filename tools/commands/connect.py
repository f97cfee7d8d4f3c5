"""``sweepctl connect``: a live session with a robot."""

from __future__ import annotations

from pathlib import Path

import click

from tools import options


@click.command(
    "connect",
    epilog="Example:  sweepctl connect /dev/ttyUSB0 --plan paper --out clean.mcap",
)
@click.argument("port")
@click.option(
    "--plan",
    "planner",
    type=click.Choice(options.PLANNERS),
    help="Run this planner on the host: the robot moves.",
)
@click.option(
    "--duration",
    "duration_s",
    type=options.Seconds(0.1, 1e6),
    help="End in order after this many seconds.",
)
@click.option("--room", help="The room, where it is known: gives coverage and a map.")
@click.option("--node", type=click.IntRange(1, 15), help="Talk to this device only.")
@click.option("--baud", type=click.IntRange(1200, 12_000_000), default=921_600, show_default=True)
@click.option(
    "--bitrate",
    type=click.IntRange(10_000, 1_000_000),
    help="Of a CAN bus whose adapter can be told.  [default: 500000]",
)
@click.option("--lan", is_flag=True, help="With can:udp_multicast: let frames leave this machine.")
@click.option("--dtr", is_flag=True, help="Set DTR (many boards reset on it).")
@click.option("--rts", is_flag=True, help="Set RTS (many boards reset on it).")
@click.option(
    "--clear-stop",
    is_flag=True,
    help="With --plan: also clear a stop that was latched for safety. Look first.",
)
@options.robot_option
@options.out_option
@options.json_option
def command(  # noqa: PLR0913 - one parameter per option
    *,
    port: str,
    planner: str | None,
    duration_s: float | None,
    room: str | None,
    node: int | None,
    baud: int,
    bitrate: int | None,
    lan: bool,
    dtr: bool,
    rts: bool,
    clear_stop: bool,
    robot: Path | None,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Open PORT, agree with the robot, record and show it.

    Nothing moves unless --plan asks for it. PORT is a device path, socket://HOST:PORT,
    rfc2217://HOST:PORT, or can:INTERFACE:CHANNEL for a CAN bus (can:slcan:/dev/ttyACM0,
    can:socketcan:can0, can:udp_multicast:239.74.163.2).
    """
    from bridge.config import load_robot
    from tools.console import complain, print_summary
    from tools.live_run import LiveOptions, run_live
    from tools.rooms import load_room

    if clear_stop and planner is None:
        raise click.UsageError("--clear-stop goes with --plan")
    model, robot_toml = load_robot(robot)
    plan = load_room(room) if room else None
    result = run_live(
        LiveOptions(
            port=port,
            log=options.log_path(out, plan.name if plan else Path(port).name),
            model=model,
            robot_toml=robot_toml,
            plan=plan,
            planner=planner,
            duration_s=duration_s,
            node=node,
            baud=baud,
            bitrate=bitrate,
            lan=lan,
            dtr=dtr,
            rts=rts,
            clear_stop=clear_stop,
            force=force,
        )
    )
    for line in result.complaints:
        complain(line)
    print_summary(result.summary, as_json=as_json)
    return result.exit_status
