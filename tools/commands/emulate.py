"""``sweepctl emulate``: a virtual sweeper on a serial port, a TCP socket or a CAN bus."""

from __future__ import annotations

import secrets
import signal
from contextlib import ExitStack, suppress
from functools import partial
from typing import TYPE_CHECKING

import click

from tools.cli import options
from tools.cli.completion import complete_room
from tools.cli.console import flush, inform, write_line
from tools.cli.paths import PathName
from tools.cli.signals import ending_signals

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel
    from bridge.record.log_writer import RunWriter
    from sim_device.body.plant import Truth
    from sim_device.faults.injector import FaultEvent
    from sim_device.faults.spec import FaultSpec
    from sim_device.line.line import LineSettings
    from sim_device.ports import DevicePort, ServeReport
    from sim_device.ports.qemu_sweeper import QemuSweeper
    from sim_device.rig import Rig
    from sim_device.rigged import RiggedDevice
    from tools.virtual.wanted import Wanted

_BITRATE = 500_000
"""Default bit rate of the CAN bus, bit/s."""
_LINKS = ("pty", "tcp", "slcan", "udpcan")
_SERIAL = {"pty", "tcp"}
_WITH = {
    "python": "",
    "core": " with the C firmware on a virtual board",
    "qemu": " with its firmware in QEMU",
}
"""Text about each target in the first message."""


@click.command(
    "emulate",
    epilog="Example:  sweepctl emulate case-1 --pty-link /tmp/sweeper --fault unplug@30:4",
)
@click.argument("room", default="case-1", shell_complete=complete_room)
@click.option(
    "--link",
    type=click.Choice(_LINKS),
    default="pty",
    show_default=True,
    help="Link to the device: a serial line (pty), a serial line over TCP (tcp), a serial CAN "
    "adapter (slcan), or a CAN bus over UDP that several devices and a host can join (udpcan).",
)
@options.target_options
@options.baud_option
@options.latency_option
@click.option(
    "--bitrate",
    type=click.IntRange(10_000, 1_000_000),
    help="With --link slcan or udpcan: bit rate of the CAN bus.  [default: 500000]",
)
@click.option(
    "--listen",
    callback=options.address,
    metavar="HOST:PORT",
    help="With --link tcp: address to listen on; port 0 is any free one.  [default: 127.0.0.1:0]",
)
@click.option(
    "--lan",
    is_flag=True,
    help="Accept other machines: with --link udpcan exchange frames with the network, with "
    "--link tcp listen on all addresses. They can then drive the virtual robot.",
)
@options.seed_option
@options.noise_option
@options.robot_option
@options.start_option
@click.option(
    "--node",
    type=click.IntRange(1, 15),
    default=1,
    show_default=True,
    help="Node number of the device.",
)
@options.fault_option
@click.option("--list-faults", is_flag=True, help="Explain each kind of fault and exit.")
@click.option(
    "--control",
    type=PathName(dir_okay=False),
    help="Unix socket to create, by which `sweepctl fault` controls faults during the run.",
)
@options.key_option
@click.option(
    "--truth",
    type=PathName(dir_okay=False),
    help="Log file for the true pose (/truth/pose, Unix time) and the faults (/events).",
)
@click.option("--force", is_flag=True, help="Replace the truth file if it exists.")
@click.option(
    "--pty-link",
    type=PathName(dir_okay=False),
    help="Symbolic link to the port to create.",
)
@click.option("--stats", is_flag=True, help="Print the timing accuracy at the end.")
@click.option("--json", "as_json", is_flag=True, help="With --list-faults: print one JSON object.")
def command(  # noqa: PLR0913 - one parameter per option
    *,
    room: str,
    link: str,
    target: str,
    firmware: Path | None,
    gdb: bool,
    baud: int | None,
    latency_ms: float | None,
    bitrate: int | None,
    listen: tuple[str, int] | None,
    lan: bool,
    seed: int,
    noise: str,
    robot: Path | None,
    start: Pose2 | None,
    node: int,
    fault: tuple[FaultSpec, ...],
    list_faults: bool,
    control: Path | None,
    key_file: Path | None,
    truth: Path | None,
    force: bool,
    pty_link: Path | None,
    stats: bool,
    as_json: bool,
) -> int:
    """Run a virtual sweeper in ROOM in real time, until Ctrl-C.

    ROOM is a room file or a name (`docs/rooms.md`); the default is case-1. The first line on
    stdout is "ready PORT"; pass this PORT to connect.
    """
    if list_faults:
        from tools.cli.fault_help import print_faults

        print_faults(as_json=as_json)
        return 0
    from bridge.config import load_robot
    from bridge.errors import BridgeError, PortError
    from protocol.can.link import CanLink
    from protocol.uart.link import Link
    from sim_device.core.chip import FirmwareCrashError
    from sim_device.ports import ControlServer, PortUnavailableError, ServeCallbacks, Stopper, serve
    from tools.cli.keyfile import read_key
    from tools.cli.rooms import load_room
    from tools.virtual import core_target, qemu_target
    from tools.virtual.wanted import Wanted

    qemu_target.check(target, link, keyed=key_file is not None)
    core_target.check(target, firmware, gdb=gdb)
    _check(link, baud, bitrate, listen, pty_link, truth, lan=lan, force=force, as_json=as_json)
    model, robot_toml = load_robot(robot)
    plan = load_room(room, model.radius_m, start)
    stopper = Stopper()
    for number in ending_signals():
        signal.signal(number, lambda _number, _frame: stopper.stop())
    try:
        with ExitStack() as stack:
            stack.callback(stopper.close)
            wanted = Wanted(
                plan=plan,
                model=model,
                seed=seed,
                noise=noise,
                node=node,
                boot_id=secrets.randbelow(0xFFFF_FFFF) + 1,  # a host must notice a restart
                link=Link if link in _SERIAL else CanLink,
                local=link == "pty",
                key=read_key(key_file),
            )
            device, chip = _device(
                stack, target, wanted, firmware, lambda: stopper.stopped, gdb=gdb
            )
            rig = options.rig(
                device, _line(link, baud, latency_ms, bitrate or _BITRATE), fault, seed
            )
            writer = None
            if truth is not None:
                writer = _truth_writer(truth, (model, robot_toml), plan, seed, noise, force=force)
                stack.callback(writer.close)
            port = stack.enter_context(_port(link, pty_link, bitrate or _BITRATE, listen, lan=lan))
            server = None
            if control is not None:
                server = ControlServer(control)
                stack.callback(server.close)
            write_line(f"ready {port.path}")
            flush()
            _notify(
                f"virtual sweeper{_WITH[target]}, node {node}, in "
                f"{plan.name} ({noise} noise, seed {seed}, {link}); press Ctrl-C to end"
            )
            callbacks = ServeCallbacks(
                on_truth=_recording(writer) if writer else None,
                on_fault=_on_fault(writer),
                on_plug=_on_plug,
            )
            _warn(plan, model, link, listen, lan=lan, keyed=key_file is not None)
            report = serve(rig, port, stopper, callbacks, server, waker=chip)
            _sum_up(rig, report, chip, asked=stats)
    except PortUnavailableError as error:
        raise PortError(str(error)) from None
    except FirmwareCrashError as error:
        core_target.print_trace(error)
        raise BridgeError(str(error)) from None
    for number in ending_signals():  # a second signal (from `timeout`) must not change the status
        signal.signal(number, signal.SIG_IGN)
    return 0


def _device(  # noqa: PLR0913 - how the device is made
    stack: ExitStack,
    target: str,
    wanted: Wanted,
    firmware: Path | None,
    ended: Callable[[], bool],
    *,
    gdb: bool,
) -> tuple[RiggedDevice, QemuSweeper | None]:
    """Return the device, which runs until ``stack`` is closed, and the chip in QEMU or None."""
    from tools.virtual import core_target, qemu_target
    from tools.virtual.wanted import python_sweeper

    if target == "qemu":
        chip = qemu_target.device(stack, wanted, firmware, _notify)
        return chip, chip
    if target == "core":
        core = core_target.device(wanted, firmware, _notify, ended, gdb=gdb)
        stack.callback(core.close)
        return core, None
    return python_sweeper(wanted), None


def _check(  # noqa: PLR0913, PLR0917 - the options that exclude each other
    link: str,
    baud: int | None,
    bitrate: int | None,
    listen: tuple[str, int] | None,
    pty_link: Path | None,
    truth: Path | None,
    *,
    lan: bool,
    force: bool,
    as_json: bool,
) -> None:
    if lan and link not in {"udpcan", "tcp"}:
        raise click.UsageError("--lan needs --link udpcan or tcp")
    if lan and listen is not None:
        raise click.UsageError("--lan and --listen exclude each other; give one")
    if listen is not None and link != "tcp":
        raise click.UsageError("--listen needs --link tcp")
    if pty_link is not None and link not in {"pty", "slcan"}:
        raise click.UsageError("--pty-link needs --link pty or slcan")
    if baud is not None and link not in _SERIAL:
        raise click.UsageError("--baud needs --link pty or tcp; for a CAN bus give --bitrate")
    if bitrate is not None and link in _SERIAL:
        raise click.UsageError("--bitrate needs --link slcan or udpcan; otherwise give --baud")
    if force and truth is None:
        raise click.UsageError("--force needs --truth: no other file is replaced")
    if as_json:
        raise click.UsageError("--json needs --list-faults")


def _warn(  # noqa: PLR0913 - one parameter for each thing to warn of
    plan: FloorPlan,
    model: RobotModel,
    link: str,
    listen: tuple[str, int] | None,
    *,
    lan: bool,
    keyed: bool,
) -> None:
    from tools.cli.cautions import caution_lines
    from tools.cli.lan_risk import port_risk

    for text in caution_lines(model, plan):
        _notify(text)
    risk = port_risk(link, listen, lan=lan, keyed=keyed)
    if risk is not None:
        _notify(f"warning: {risk}")


def _line(link: str, baud: int | None, latency_ms: float | None, bitrate: int) -> LineSettings:
    from sim_device.line.line import DEFAULT_BAUD, DEFAULT_LATENCY_US, LineSettings

    default_us = 0 if link == "udpcan" else DEFAULT_LATENCY_US
    latency_us = default_us if latency_ms is None else round(1000.0 * latency_ms)
    if link in _SERIAL:
        return LineSettings(DEFAULT_BAUD if baud is None else baud, latency_us)
    return LineSettings(0, latency_us, bitrate)


def _port(
    link: str, pty_link: Path | None, bitrate: int, listen: tuple[str, int] | None, *, lan: bool
) -> DevicePort:
    from sim_device.ports import MulticastPort, PtyPort, SlcanPort, TcpServerPort

    match link:
        case "slcan":
            return SlcanPort(pty_link, bitrate=bitrate)
        case "udpcan":
            from bridge.io.multicast import MulticastBus

            return MulticastPort(partial(MulticastBus, lan=lan))
        case "tcp":
            host, number = listen or ("0.0.0.0" if lan else "127.0.0.1", 0)  # noqa: S104 - --lan
            return TcpServerPort(host, number, _notify)
        case _:
            return PtyPort(pty_link)


def _notify(text: str) -> None:
    """Print a message; if stderr is closed, the device keeps running."""
    with suppress(OSError, ValueError):
        inform(text)


def _on_plug(name: str | None) -> None:
    _notify("the port is unplugged" if name is None else f"the port is back: {name}")


def _on_fault(writer: RunWriter | None) -> Callable[[FaultEvent, int], None]:
    from tools.cli.fault_help import fault_record

    def notify(event: FaultEvent, unix_ns: int) -> None:
        _notify(f"fault at {event.t_us / 1e6:.2f} s: {event.text}")
        if writer is not None:
            writer.write(fault_record(event, unix_ns))

    return notify


def _sum_up(rig: Rig, report: ServeReport, chip: QemuSweeper | None, *, asked: bool) -> None:
    counts, late = rig.counts(), report.lateness
    if asked and late.periods:
        _notify(
            f"ran {report.duration_s:.1f} s in {late.periods} periods: lateness "
            f"{late.percentile_us(99.0) / 1000:.2f} ms at the 99th percentile, "
            f"{late.worst_us / 1000:.2f} ms at most; "
            f"{counts.to_host} B to the host, {counts.from_host} B from the host"
        )
    if asked and chip is not None:
        _notify(f"{chip.stack_free} B of the firmware's stack were never used")
    lost = {
        "in the device: it sent more than the line carries": counts.device_overrun,
        "in the adapter: the host did not read": counts.adapter_overrun,
    }
    for where, count in lost.items():
        if count and (asked or rig.host_heard):
            _notify(f"{count} B were lost {where}")


def _truth_writer(  # noqa: PLR0913 - one parameter for each part of the log's metadata
    path: Path,
    robot: tuple[RobotModel, str],
    plan: FloorPlan,
    seed: int,
    noise: str,
    *,
    force: bool,
) -> RunWriter:
    from bridge.io import clock
    from bridge.record.log_writer import RunWriter
    from bridge.record.names import EMULATED_PORT
    from bridge.session.records import RoomRecord, RunInfo
    from tools.version import VERSION

    offset_ns = clock.unix_offset_ns()
    opened_ns = clock.now() + offset_ns
    extra = {"noise": noise}
    info = RunInfo(EMULATED_PORT, "", seed, VERSION, opened_ns, offset_ns, *robot, plan, extra)
    writer = RunWriter(path, info, force=force)
    writer.write(RoomRecord(opened_ns, plan))
    return writer


def _recording(writer: RunWriter) -> Callable[[Truth, int], None]:
    from bridge.session.records import TruthRecord

    period_ms, last_ms = 20, [-20]

    def record(truth: Truth, unix_ns: int) -> None:
        if truth.tick_ms - last_ms[0] >= period_ms:
            last_ms[0] = truth.tick_ms
            writer.write(TruthRecord(unix_ns, truth.pose))

    return record
