"""``sweepctl drive``: manual driving with a dead-man switch."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import click

from tools.bringup.session import clear_stop_option
from tools.cli import options
from tools.cli.console import print_error, print_summary
from tools.cli.port_options import PortAsked, keyed_port_options
from tools.cli.recording import recording_options, take_record_options


@click.command("drive", epilog="Example:  sweepctl drive /dev/ttyUSB0 --gamepad /dev/input/js0")
@keyed_port_options
@click.option(
    "--speed",
    "speed_m_s",
    type=options.Number(0.03, 2.0),
    default=0.15,
    show_default=True,
    metavar="M/S",
    help="Speed of a held key or a stick at its end; the keys + and - change it. A tapped key "
    "drives at 0.1 m/s at most.",
)
@click.option(
    "--gamepad",
    metavar="DEVICE",
    help="Linux joystick (/dev/input/js0): hold the left shoulder button and steer with the left "
    "stick; B stops.",
)
@options.duration_option
@clear_stop_option
@options.robot_option
@options.out_option
@recording_options
@options.json_option
def command(  # noqa: PLR0913 - one parameter per option
    *,
    port: PortAsked,
    speed_m_s: float,
    gamepad: str | None,
    duration_s: float | None,
    clear_stop: bool,
    robot: Path | None,
    out: Path | None,
    force: bool,
    as_json: bool,
    **recording: Any,  # noqa: ANN401 - click's values
) -> int:
    """Drive the robot on PORT by keyboard or gamepad: THE ROBOT MOVES.

    The arrow keys (or i j k l) drive while you hold them, in terminals that report key releases
    (kitty, foot, WezTerm, Ghostty and others). In other terminals a key press drives for 0.7 s at
    0.1 m/s, and any other key stops. Space or s stops the robot, latches the stop and ends the run.
    The run is recorded.
    """
    from bridge.config import load_robot
    from bridge.io.gamepad import open_joystick
    from bridge.io.reopening import PortOptions
    from bridge.run.mission import Resume
    from tools.live.run import LiveOptions, run_live
    from tools.live.terminal_keys import Keyboard

    if gamepad is None and not Keyboard.possible():
        raise click.UsageError("drive needs a terminal with a keyboard, or --gamepad DEVICE")
    if gamepad is not None:  # before the port is opened
        os.close(open_joystick(gamepad))
    model, robot_toml = load_robot(robot)
    result = run_live(
        LiveOptions(
            port=port.name,
            log=options.log_path(out, Path(port.name).name),
            model=model,
            robot_toml=robot_toml,
            plan=None,
            planner=None,
            onboard=None,
            supervise=None,
            resume=Resume.NEVER,
            duration_s=duration_s,
            node=port.node,
            key=port.key,
            opening=PortOptions(**port.how),
            clear_stop=clear_stop,
            force=force,
            drive=True,
            speed_m_s=speed_m_s,
            gamepad=gamepad,
            robot_file=robot is not None,
            recording=take_record_options(recording),
        )
    )
    for line in result.complaints:
        print_error(line)
    if as_json or result.negotiated or not result.complaints:
        print_summary(result.summary, as_json=as_json)
    return result.exit_status
