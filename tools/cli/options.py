"""Options that several commands share."""

from __future__ import annotations

import math
import secrets
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tools.cli.completion import complete_fault, complete_robot
from tools.cli.paths import is_there

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sim_device.faults.spec import FaultSpec
    from sim_device.line.line import LineSettings
    from sim_device.rig import Rig
    from sim_device.rigged import RiggedDevice

NOISE_LEVELS = ("none", "paper", "typical", "harsh")
PLANNERS = ("recovery", "paper", "u-shape", "random")
DEFAULT_PLANNER = "recovery"


class Number(click.FloatRange):
    """A number in a range; "nan" is in none."""

    name = "number"

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's interface
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> float:
        """Read the number."""
        number = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f"{value!r} is not a number.", param, ctx)
        return number


class Baud(click.IntRange):
    """A baud rate, or 0 for none."""

    def __init__(self) -> None:
        super().__init__(0, 12_000_000)

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's interface
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> int:
        """Read it."""
        number = int(super().convert(value, param, ctx))
        if 0 < number < _MIN_BAUD:
            self.fail(f"{number} is not 0, nor in the range {_MIN_BAUD}<=x<=12000000.", param, ctx)
        return number


_MIN_BAUD = 1200


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
    """``HOST:PORT`` in two, an IPv6 address in brackets."""
    if text is None:
        return None
    host, colon, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not colon or not host or not port.isascii() or not port.isdigit():
        raise click.BadParameter(f"{text!r} is not HOST:PORT.", ctx, param)
    if int(port) > _MAX_PORT:
        raise click.BadParameter(f"port {port} is not in 0 to {_MAX_PORT}.", ctx, param)
    return host, int(port)


_MAX_PORT = 65_535


def fault_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--fault``, any number of times."""
    return click.option(
        "--fault",
        callback=_faults,
        shell_complete=complete_fault,
        multiple=True,
        metavar="SPEC",
        help="Inject kind@time[:for][:name=value,...], in seconds since the device "
        "booted. Repeatable. `sweepctl emulate --list-faults` explains the kinds.",
    )(f)


def baud_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--baud`` of the virtual line."""
    return click.option(
        "--baud",
        type=Baud(),
        help="Baud rate at which bytes are paced, 10 bits each; 0: unlimited.  [default: 921600]",
    )(f)


def latency_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--latency-ms`` of the virtual adapter."""
    return click.option(
        "--latency-ms",
        type=Number(0.0, 1000.0),
        help="Latency timer of the USB adapter, ms; FTDI's default is 16.  [default: 1; udpcan: 0]",
    )(f)


def rig(
    device: RiggedDevice,
    line: LineSettings,
    faults: tuple[FaultSpec, ...],
    seed: int,
    cannot: Mapping[str, str] | None = None,
) -> Rig:
    """Connect a device as asked for.

    Raises:
        click.BadParameter: a fault cannot be on this device.

    """
    from sim_device.faults.spec import FaultSpecError
    from sim_device.rig import Rig

    try:
        return Rig(device, line, faults, seed=seed, cannot=cannot or {})
    except FaultSpecError as error:
        raise click.BadParameter(str(error), param_hint="'--fault'") from None


def out_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--out`` and ``--force``."""
    f = click.option("--force", is_flag=True, help="Replace the log file if it exists.")(f)
    return click.option(
        "--out",
        type=click.Path(dir_okay=False, path_type=Path),
        help="Log file.  [default: runs/<UTC>-<name>.mcap]",
    )(f)


def json_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--json``."""
    return click.option(
        "--json",
        "as_json",
        is_flag=True,
        help="Print one JSON object on stdout, and all messages on stderr.",
    )(f)


def port_options(f: Callable[..., object]) -> Callable[..., object]:
    """``--node``, ``--baud``, ``--bitrate``, ``--lan``, ``--dtr``, ``--rts`` of opening a port."""
    for option in (
        click.option("--rts", is_flag=True, help="Set RTS (this resets many boards)."),
        click.option("--dtr", is_flag=True, help="Set DTR (this resets many boards)."),
        click.option(
            "--lan",
            is_flag=True,
            help="With can:udp_multicast: send frames to other machines and accept theirs.",
        ),
        click.option(
            "--bitrate",
            type=click.IntRange(10_000, 1_000_000),
            help="CAN bit rate, if the adapter can set it.  [default: 500000]",
        ),
        click.option(
            "--baud",
            type=click.IntRange(1200, 12_000_000),
            default=921_600,
            show_default=True,
            help="Serial baud rate.",
        ),
        click.option("--node", type=click.IntRange(1, 15), help="Talk to this device only."),
    ):
        f = option(f)
    return f


def key_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--key-file``."""
    return click.option(
        "--key-file",
        type=click.Path(dir_okay=False, path_type=Path),
        help="File with the key that authenticates motion commands (see sweepctl key).",
    )(f)


def robot_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--robot``."""
    return click.option(
        "--robot",
        type=click.Path(dir_okay=False, path_type=Path),
        shell_complete=complete_robot,
        help="Robot file (TOML).  [default: the paper's robot]",
    )(f)


def noise_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--noise``."""
    return click.option(
        "--noise",
        type=click.Choice(NOISE_LEVELS),
        default="typical",
        show_default=True,
        help="Noise level of the virtual sensors and wheels.",
    )(f)


def seed_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--seed``."""
    return click.option(
        "--seed",
        type=click.IntRange(0, 2**63 - 1),
        default=0,
        show_default=True,
        help="Random seed: equal seeds give equal runs.",
    )(f)


_NAME_BYTES = 100
"""Bytes of a room's or port's name in a log's name. With stamp and ending 255 may not be passed."""


def log_path(out: Path | None, name: str) -> Path:
    """The log to write; a default one gets its folder.

    Raises:
        LogWriteError: that folder cannot be made.

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
    while is_there(path):  # two runs in one second
        path = path.with_name(f"{stamp}-{clean}-{secrets.token_hex(2)}.mcap")
    return path
