"""The message of the dust sensor, declared once for firmware, host and logs."""

from __future__ import annotations

from typing import Annotated

from protocol.schema.fields import U8, U16, number, si
from protocol.schema.message import Direction, Message, RateClass, message


@message(0x50, Direction.DEVICE, RateClass.STREAM, default_hz=2)
class Dust(Message):
    """Particles in the suction air."""

    particles: Annotated[int, number(U16, "count", "since boot; wraps")]
    rate: Annotated[int, number(U16, "Hz", "particles a second", scale="0.1")]
    full: Annotated[int, number(U8, "percent", "of the bin", high=100)]

    rate_hz = si("rate")
