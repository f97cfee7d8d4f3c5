"""``--adapter-delay``: what a person declares of the way between host and device."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Callable

MAX_MS = 1000.0


def adapter_delay_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--adapter-delay``; the command gets ``adapter_delay_ns``, to the device and from it."""
    return click.option(
        "--adapter-delay",
        "adapter_delay_ns",
        callback=_delays,
        metavar="OUT_MS,IN_MS",
        help="Minimum delay to and from the device, ms. It tightens the bounds on time "
        "stamps, so it must be true: 0.17,0.17 holds for a UART at 921600.  [default: "
        "0,0]",
    )(f)


def _delays(ctx: click.Context, param: click.Parameter, text: str | None) -> tuple[int, int]:
    """Two times in milliseconds as nanoseconds."""
    if text is None:
        return 0, 0
    try:
        out_ms, in_ms = map(float, text.split(","))
    except ValueError:
        raise click.BadParameter(
            f"{text!r} is not OUT_MS,IN_MS, two times in milliseconds.", ctx, param
        ) from None
    for value_ms in (out_ms, in_ms):
        if math.isnan(value_ms) or not 0.0 <= value_ms <= MAX_MS:
            raise click.BadParameter(f"{value_ms:g} ms is not in 0 to {MAX_MS:g} ms.", ctx, param)
    return round(1e6 * out_ms), round(1e6 * in_ms)
