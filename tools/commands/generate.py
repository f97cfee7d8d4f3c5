"""``sweepctl generate``: the protocol in other languages."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any, ClassVar

import click

from protocol.generate import GENERATORS, PER_NODE
from protocol.imu import NOMINAL, ImuScale
from tools.cli.console import print_error, write_line
from tools.cli.outputs import check_outputs
from tools.cli.paths import PathName

if TYPE_CHECKING:
    from pathlib import Path


_SCALE = (Fraction(1, 10_000), Fraction(2**32 - 1, 10_000))
"""Range of the scales in ``imu_info``."""
_ZERO_DEG_C = (Fraction(-(2**15), 100), Fraction(2**15 - 1, 100))
"""Range of the temperature in ``imu_info``, °C."""


class ImuScaleType(click.ParamType):  # type: ignore[type-arg]  # generic in the stubs only
    """Parameter type: scale of an IMU's counts; an omitted part has its nominal value."""

    name = "scale"
    _KEYS: ClassVar = {
        "accel": "per_g",
        "gyro": "per_deg_s",
        "temperature": "per_k",
        "zero": "zero_deg_c",
    }

    def convert(
        self,
        value: str,
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> ImuScale:
        """Read ``accel=8192,gyro=65.5``."""
        changes: dict[str, Fraction] = {}
        for item in value.split(","):
            key, _, text = item.partition("=")
            name = self._KEYS.get(key.strip())
            if name is None:
                self.fail(f"{key.strip()!r} is none of {', '.join(self._KEYS)}", param, ctx)
            if name in changes:
                self.fail(f"{key.strip()} is given twice: give one value", param, ctx)
            try:
                number = Fraction(text.strip())
            except (ValueError, ZeroDivisionError):
                self.fail(f"{key.strip()}: {text.strip()!r} is not a number", param, ctx)
            low, high = _ZERO_DEG_C if key.strip() == "zero" else _SCALE
            if not low <= number <= high:
                between = f"from {float(low):g} to {float(high):.8g}"
                self.fail(f"{key.strip()}: {text.strip()} is not {between}", param, ctx)
            changes[name] = number
        return replace(NOMINAL, **changes)


@click.command("generate", epilog="Example:  sweepctl generate c --out firmware/protocol")
@click.argument("what", type=click.Choice(list(GENERATORS)))
@click.option(
    "--out",
    type=PathName(file_okay=False),
    required=True,
    help="Output folder; created if it does not exist.",
)
@click.option(
    "--node",
    type=click.IntRange(1, 15),
    help="With dbc: node number of the device.  [default: 1]",
)
@click.option(
    "--imu",
    type=ImuScaleType(),
    metavar="KEY=VALUE,...",
    help="With dbc: scale of the device's IMU, as in its imu_info: accel "
    "(counts per g), gyro (counts per degree per second), temperature (counts per kelvin), zero "
    "(°C at a raw count of 0).  [default: an MPU6050 at ±2 g and ±250 °/s]",
)
@click.option("--force", is_flag=True, help="Replace existing files.")
def command(*, what: str, out: Path, node: int | None, imu: ImuScale | None, force: bool) -> int:
    """Generate code or documentation from the declaration of the protocol.

    \b
    c      header and source in C99, for firmware
    dbc    CAN database, for cantools, SavvyCAN and others
    lua    Wireshark dissector
    proto  protobuf declarations of the messages in a log
    md     specification: wire format, states, timing
    """  # noqa: D301 - after \b click keeps the line breaks of a paragraph
    from bridge.files import write_whole
    from protocol.generate import render

    if node is not None and what not in PER_NODE:
        raise click.UsageError("--node needs dbc: the other formats do not depend on the node")
    if imu is not None and what != "dbc":
        raise click.UsageError("--imu needs dbc: the other formats carry the counts as they are")
    options: dict[str, Any] = {} if imu is None else {"imu": imu}
    if what == "md":
        from tools.dev.behaviour import wire_behaviour

        options["behaviour"] = wire_behaviour()
    files = render(what, node=node or 1, **options)
    check_outputs([out / name for name in files], (), force=force)
    path = out
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            path = out / name
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, text.encode())
    except OSError as error:
        print_error(f"cannot write {path}: {error.strerror}")
        return 1
    for name in files:
        write_line(str(out / name))
    return 0
