"""``--adapter-delay``: the declared minimum delay between host and device."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Callable

MAX_MS = 1000.0
"""Maximum delay that can be declared, ms. A longer delay is probably a typing error."""


def adapter_delay_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--adapter-delay``.

    The command gets ``adapter_delay_ns``: the delay to the device and the delay from it.
    """
    return click.option(
        "--adapter-delay",
        "adapter_delay_ns",
        callback=_delays,
        metavar="OUT_MS,IN_MS",
        help="Minimum delay of a frame to the device and from it, ms. The error bound of time "
        "stamps shrinks by it, and is wrong if a frame is faster. For a UART at 921600 baud "
        "0.17,0.17 holds.  [default: 0,0]",
    )(f)


def _delays(ctx: click.Context, param: click.Parameter, text: str | None) -> tuple[int, int]:
    """Convert two times in milliseconds to nanoseconds."""
    if text is None:
        return 0, 0
    try:
        out_ms, in_ms = map(float, text.split(","))
    except ValueError:
        raise click.BadParameter(
            f"{text!r} is not OUT_MS,IN_MS: two times in milliseconds.", ctx, param
        ) from None
    for value_ms in (out_ms, in_ms):
        if math.isnan(value_ms) or not 0.0 <= value_ms <= MAX_MS:
            text = f"{value_ms:g} ms is not in the range 0 to {MAX_MS:g} ms."
            raise click.BadParameter(text, ctx, param)
    return round(1e6 * out_ms), round(1e6 * in_ms)
