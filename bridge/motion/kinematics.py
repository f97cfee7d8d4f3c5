"""Encoder counts."""

from __future__ import annotations

ENCODER_MODULUS = 1 << 16
_HALF = ENCODER_MODULUS >> 1


def encoder_delta(previous: int, current: int) -> int:
    """Return the counts from ``previous`` to ``current`` of a wrapping 16-bit counter.

    The result is the shorter difference, in [-32768, 32767]. It is right while the wheel turns by
    less than half the counter's range, 4.3 m with the default wheel.
    """
    return ((current - previous + _HALF) % ENCODER_MODULUS) - _HALF
