"""A message of a maker: what an optical dust sensor counts."""

from __future__ import annotations

from typing import Annotated

from protocol.schema.fields import U8, U16, number, si
from protocol.schema.message import Direction, Message, RateClass, message


@message(0x50, Direction.DEVICE, RateClass.STREAM, default_hz=2)
class Dust(Message):
    """What the suction brings in."""

    particles: Annotated[int, number(U16, "count", "since boot; wraps")]
    rate: Annotated[int, number(U16, "Hz", "particles a second", scale="0.1")]
    full: Annotated[int, number(U8, "percent", "of the bin", high=100)]

    rate_hz = si("rate")

    @staticmethod
    def simulated(now_us: int) -> Dust:
        """What the virtual sweeper sends: a house that is evenly dirty, 20 particles a second."""
        particles = now_us // 50_000
        return Dust(particles & 0xFFFF, 200, min(100, particles // 1000))
