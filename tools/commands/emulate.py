"""``sweepctl emulate``: a virtual sweeper on a pseudo-terminal or a CAN bus."""

from __future__ import annotations

import secrets
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from tools import options

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.coverage.floorplan import FloorPlan
    from bridge.record.writer import RunWriter
    from sim_device.plant import Truth
    from sim_device.ports import MulticastPort, PtyPort


@click.command("emulate", epilog="Example:  sweepctl emulate case-1 --pty-link /tmp/sweeper")
@click.argument("room", default="case-1")
@click.option(
    "--link",
    type=click.Choice(["pty", "slcan", "udpcan"]),
    default="pty",
    show_default=True,
    help="What the device is connected by: a serial line, a serial CAN adapter, or a CAN bus "
    "of UDP datagrams that several devices and one host can join.",
)
@click.option(
    "--bitrate",
    type=click.IntRange(10_000, 1_000_000),
    default=500_000,
    show_default=True,
    help="Of the bus behind the serial CAN adapter.",
)
@click.option("--lan", is_flag=True, help="With udpcan: let frames leave this machine.")
@options.seed_option
@options.noise_option
@options.robot_option
@click.option("--node", type=click.IntRange(1, 15), default=1, show_default=True)
@click.option(
    "--truth",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Log where the robot really is (/truth/pose, Unix time).",
)
@click.option("--force", is_flag=True, help="Replace the truth file if it exists.")
@click.option(
    "--pty-link",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Also make this symbolic link to the port.",
)
def command(  # noqa: PLR0913 - one parameter per option
    *,
    room: str,
    link: str,
    bitrate: int,
    lan: bool,
    seed: int,
    noise: str,
    robot: Path | None,
    node: int,
    truth: Path | None,
    force: bool,
    pty_link: Path | None,
) -> int:
    """Run a virtual sweeper in ROOM, in real time, until ended by a signal.

    The first line on stdout is "ready PORT", where PORT can be passed to connect.
    """
    from bridge.config import load_robot
    from bridge.errors import PortError
    from protocol.can_link import CanLink
    from protocol.link import Link
    from sim_device.device import VirtualSweeper
    from sim_device.ports import PortUnavailableError, Stopper, serve
    from tools.console import say
    from tools.rooms import load_room

    if lan and link != "udpcan":
        raise click.UsageError("--lan goes with --link udpcan")
    if pty_link is not None and link == "udpcan":
        raise click.UsageError("--pty-link goes with --link pty or slcan")
    plan = load_room(room)
    model, robot_toml = load_robot(robot)
    kind = Link if link == "pty" else CanLink
    boot_id = secrets.randbelow(0xFFFF_FFFF) + 1  # a host must notice that it was started anew
    device = VirtualSweeper(
        plan, model, seed=seed, noise=noise, node=node, link=kind, boot_id=boot_id
    )
    stopper = Stopper()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda _number, _frame: stopper.stop())
    writer = _truth_writer(truth, robot_toml, plan, seed, noise, force=force) if truth else None
    try:
        with _port(link, pty_link, bitrate, lan=lan) as port:
            sys.stdout.write(f"ready {port.path}\n")
            sys.stdout.flush()
            say(
                f"virtual sweeper, node {node}, in {plan.name} ({noise} noise, seed {seed}, "
                f"{link}); Ctrl-C ends it"
            )
            serve(device, port, stopper, _recording(writer) if writer else None)
    except PortUnavailableError as error:
        raise PortError(str(error)) from None
    finally:
        if writer is not None:
            writer.close()
    return 0


def _port(link: str, pty_link: Path | None, bitrate: int, *, lan: bool) -> PtyPort | MulticastPort:
    from sim_device.ports import MulticastPort, PtyPort, SlcanPort

    match link:
        case "slcan":
            return SlcanPort(pty_link, bitrate=bitrate)
        case "udpcan":
            return MulticastPort(lan=lan)
        case _:
            return PtyPort(pty_link)


def _truth_writer(  # noqa: PLR0913 - what a log says of itself
    path: Path, robot_toml: str, plan: FloorPlan, seed: int, noise: str, *, force: bool
) -> RunWriter:
    from bridge.io import clock
    from bridge.record.writer import RunWriter
    from bridge.telemetry import RoomRecord, RunInfo
    from tools.version import VERSION

    offset_ns = clock.unix_offset_ns()
    opened_ns = clock.now() + offset_ns
    extra = {"noise": noise}
    info = RunInfo("emulated", "", seed, VERSION, opened_ns, offset_ns, robot_toml, plan, extra)
    writer = RunWriter(path, info, force=force)
    writer.write(RoomRecord(opened_ns, plan))
    return writer


def _recording(writer: RunWriter) -> Callable[[Truth, int], None]:
    from bridge.telemetry import TruthRecord

    period_ms, last_ms = 20, [-20]

    def record(truth: Truth, unix_ns: int) -> None:
        if truth.tick_ms - last_ms[0] >= period_ms:
            last_ms[0] = truth.tick_ms
            writer.write(TruthRecord(unix_ns, truth.pose))

    return record
