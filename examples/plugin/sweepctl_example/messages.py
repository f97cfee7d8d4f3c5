"""A manufacturer's message: the counts of an optical dust sensor."""

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

    @staticmethod
    def simulated(now_us: int) -> Dust:
        """Return the virtual sweeper's message: 20 particles a second, an evenly dirty house."""
        particles = now_us // 50_000
        return Dust(particles & 0xFFFF, 200, min(100, particles // 1000))
