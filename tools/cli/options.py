"""Options that several commands share."""

from __future__ import annotations

import math
import secrets
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tools.cli import planners
from tools.cli.completion import complete_fault, complete_robot
from tools.cli.configuration import NOISE_LEVELS, ConfiguredOption
from tools.cli.paths import PathName, is_there

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.motion.geometry import Pose2
    from sim_device.faults.spec import FaultSpec
    from sim_device.line.line import LineSettings
    from sim_device.rig import Rig
    from sim_device.rigged import RiggedDevice


class Number(click.FloatRange):
    """Parameter type: a number in a range. "nan" is rejected."""

    name = "number"

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's interface
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> float:
        """Convert the text to a number."""
        number = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f"{value!r} is not a number.", param, ctx)
        return number


class Baud(click.IntRange):
    """Parameter type: a baud rate, or 0 for a link that does not limit the data rate."""

    def __init__(self) -> None:
        super().__init__(0, 12_000_000)

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's interface
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> int:
        """Convert the text to a rate in baud."""
        number = int(super().convert(value, param, ctx))
        if 0 < number < _MIN_BAUD:
            self.fail(f"{number} is not 0 or in the range {_MIN_BAUD}<=x<=12000000.", param, ctx)
        return number


_MIN_BAUD = 1200
"""Minimum rate of the virtual serial line, baud: equal to the minimum for a real port."""


def _faults(
    ctx: click.Context, param: click.Parameter, texts: tuple[str, ...]
) -> tuple[FaultSpec, ...]:
    from sim_device.faults.kinds import parse_fault
    from sim_device.faults.spec import FaultSpecError

    try:
        return tuple(parse_fault(text) for text in texts)
    except FaultSpecError as error:
        raise click.BadParameter(str(error), ctx, param) from None


def address(ctx: click.Context, param: click.Parameter, text: str | None) -> tuple[str, int] | None:
    """Split ``HOST:PORT``; an IPv6 address must be in brackets."""
    if text is None:
        return None
    host, colon, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not colon or not host or not port.isascii() or not port.isdigit():
        raise click.BadParameter(f"{text!r} is not HOST:PORT.", ctx, param)
    if int(port) > _MAX_PORT:
        raise click.BadParameter(f"port {port} is not in the range 0 to {_MAX_PORT}.", ctx, param)
    return host, int(port)


_MAX_PORT = 65_535
"""Highest TCP port number."""


def _pose(ctx: click.Context, param: click.Parameter, text: str | None) -> Pose2 | None:
    """Read ``X,Y,DEG``: metres and degrees."""
    if text is None:
        return None
    from bridge.motion.geometry import Pose2, wrap_angle

    try:
        x_m, y_m, heading_deg = (float(part) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(f"{text!r} is not X,Y,DEG.", ctx, param) from None
    if not all(abs(value) <= _MAX_START for value in (x_m, y_m, heading_deg)):
        raise click.BadParameter(f"{text!r} is out of range.", ctx, param)
    return Pose2(x_m, y_m, wrap_angle(math.radians(heading_deg)))


_MAX_START = 1000.0
"""Maximum value in a start pose, m or degrees. The room itself limits the pose more strictly."""


def plan_options(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--plan``, ``--supervise`` and ``--onboard``."""
    for option in (
        click.option(
            "--onboard",
            type=click.Choice(planners.PLANNERS),
            help="With --supervise: planner that the device runs.  "
            f"[default: {planners.DEFAULT_PLANNER}]",
        ),
        click.option(
            "--supervise",
            is_flag=True,
            help="Start the device's own planner and supervise it: the robot moves.",
        ),
        click.option(
            "--plan",
            "planner",
            type=planners.PlannerName(),
            help="Run this planner on the host: the robot moves.",
        ),
    ):
        f = option(f)
    return f


def duration_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--duration`` of a run."""
    return click.option(
        "--duration",
        "duration_s",
        type=Number(0.1, 1e6),
        metavar="N",
        help="Stop cleanly after N seconds.",
    )(f)


def start_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--start``."""
    return click.option(
        "--start",
        callback=_pose,
        metavar="X,Y,DEG",
        help="Start pose instead of the room's: metres, and degrees counter-clockwise from x.",
    )(f)


def fault_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--fault``, which may be repeated."""
    return click.option(
        "--fault",
        callback=_faults,
        shell_complete=complete_fault,
        multiple=True,
        metavar="SPEC",
        help="Fault to inject: kind@time[:for][:name=value,...], in seconds since the device "
        "booted; may be repeated. `sweepctl emulate --list-faults` explains each kind.",
    )(f)


def baud_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--baud`` of the virtual serial line."""
    return click.option(
        "--baud",
        type=Baud(),
        help="Baud rate of the virtual serial line, 10 bits a byte; 0: no pacing.  "
        "[default: 921600]",
    )(f)


def latency_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--latency-ms`` of the virtual USB adapter."""
    return click.option(
        "--latency-ms",
        type=Number(0.0, 1000.0),
        help="Latency timer of the virtual USB adapter, ms; an FTDI adapter has 16 by default.  "
        "[default: 1; udpcan: 0]",
    )(f)


def rig(
    device: RiggedDevice,
    line: LineSettings,
    faults: tuple[FaultSpec, ...],
    seed: int,
) -> Rig:
    """Connect a virtual device to a line and its faults.

    Args:
        device: the virtual sweeper.
        line: properties of the link to the host.
        faults: faults of ``--fault``.
        seed: seed of everything random in the line and the faults.

    Raises:
        click.BadParameter: the device does not support a fault.

    """
    from sim_device.faults.spec import FaultSpecError
    from sim_device.rig import Rig

    try:
        return Rig(device, line, faults, seed=seed)
    except FaultSpecError as error:
        raise click.BadParameter(str(error), param_hint="'--fault'") from None


def target_options(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--target``, ``--firmware`` and ``--gdb``."""
    for option in (
        click.option(
            "--gdb",
            is_flag=True,
            help="With --target core: wait until a debugger has attached to the process that runs "
            "the firmware.",
        ),
        click.option(
            "--firmware",
            type=PathName(exists=True, dir_okay=False),
            metavar="FILE",
            help="Firmware of your own: with --target core a shared library "
            "(`make -C sim_device/firmware library`), which runs in a separate process; with "
            "--target qemu an ELF file.  [default: the C firmware of sweepctl]",
        ),
        click.option(
            "--target",
            type=click.Choice(("python", "core", "qemu")),
            default="python",
            show_default=True,
            help="Firmware of the device: the model in Python (python), the C firmware on a "
            "virtual board (core), or the C firmware on an STM32F405 in QEMU (qemu; only emulate; "
            "needs qemu-system-arm and, for the first build, gcc-arm-none-eabi).",
        ),
    ):
        f = option(f)
    return f


def out_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--out`` and ``--force``."""
    f = click.option("--force", is_flag=True, help="Replace the log file if it exists.")(f)
    return click.option(
        "--out",
        type=PathName(dir_okay=False),
        callback=_no_dash,
        help="Log file to write.  [default: runs/<UTC>-<room or port>.mcap]",
    )(f)


def _no_dash(
    ctx: click.Context,  # noqa: ARG001 - click's interface
    param: click.Parameter,  # noqa: ARG001 - click's interface
    value: Path | None,
) -> Path | None:
    """Reject ``-``, because a log must be a file.

    Raises:
        click.BadParameter: the path is ``-``.

    """
    if value == Path("-"):
        raise click.BadParameter("a log cannot go to stdout: give the name of a file")
    return value


def json_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--json``."""
    return click.option(
        "--json",
        "as_json",
        is_flag=True,
        help="Print one JSON object on stdout, and all messages on stderr.",
    )(f)


def port_options(f: Callable[..., object]) -> Callable[..., object]:
    """Add the options by which a port is opened, from ``--node`` to ``--rts``."""
    for option in (
        click.option("--rts", is_flag=True, help="Assert RTS when opening (may reset the board)."),
        click.option("--dtr", is_flag=True, help="Assert DTR when opening (may reset the board)."),
        click.option(
            "--lan",
            is_flag=True,
            help="With can:udp_multicast: exchange frames with other machines on the network.",
        ),
        click.option(
            "--bitrate",
            cls=ConfiguredOption,
            type=click.IntRange(10_000, 1_000_000),
            help="CAN bit rate, for adapters that can be configured.  [default: 500000]",
        ),
        click.option(
            "--baud",
            cls=ConfiguredOption,
            type=click.IntRange(1200, 12_000_000),
            default=921_600,
            show_default=True,
            help="Serial baud rate.",
        ),
        click.option(
            "--node",
            cls=ConfiguredOption,
            type=click.IntRange(1, 15),
            help="Node number of the device, where several share a bus.",
        ),
    ):
        f = option(f)
    return f


def key_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--key-file``."""
    return click.option(
        "--key-file",
        cls=ConfiguredOption,
        type=PathName(dir_okay=False),
        help="Key file that authenticates motion (`sweepctl key` makes one).",
    )(f)


def robot_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--robot``."""
    return click.option(
        "--robot",
        cls=ConfiguredOption,
        type=PathName(dir_okay=False),
        shell_complete=complete_robot,
        help="Robot file (TOML).  [default: the paper's robot]",
    )(f)


def noise_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--noise``."""
    return click.option(
        "--noise",
        cls=ConfiguredOption,
        type=click.Choice(NOISE_LEVELS),
        default="typical",
        show_default=True,
        help="Noise level of the virtual sensors and wheels.",
    )(f)


def seed_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--seed``."""
    return click.option(
        "--seed",
        type=click.IntRange(0, 2**63 - 1),
        default=0,
        show_default=True,
        help="Seed of everything random; equal seeds give equal runs.",
    )(f)


_NAME_BYTES = 100
"""Maximum length of a room's or port's name in the name of a log, bytes. With time stamp and suffix
the name stays below the 255 bytes that file systems allow."""


def log_path(out: Path | None, name: str) -> Path:
    """Return the path of the log to write; for the default path, make its folder.

    Raises:
        LogWriteError: the folder cannot be made.

    """
    if out is not None:
        return out
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")  # noqa: TID251 - names a file
    clean = "".join(c if c.isalnum() or c in "-_." else "-" for c in name).strip("-.") or "run"
    clean = clean.encode()[:_NAME_BYTES].decode(errors="ignore")
    path = Path("runs") / f"{stamp}-{clean}.mcap"
    try:
        path.parent.mkdir(exist_ok=True)
    except OSError as error:
        from bridge.record.errors import LogWriteError

        raise LogWriteError.of(path, error) from None
    while is_there(path):  # two runs began in the same second
        path = path.with_name(f"{stamp}-{clean}-{secrets.token_hex(2)}.mcap")
    return path
