"""Floats with the fewest digits that read back as the same value, compiled.

Of several such texts the nearest one, by Raffaello Giulietti's Schubfach (2020): with g = 10⁻ᵏ to
128 bits, the value and the ends of the interval that rounds to it are scaled by one product each,
rounded to odd, and compared as integers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

FIRST_POWER, _LAST_POWER = -292, 324
"""Of ten, in the table that floats are written with."""

_LOW, _HALF = np.uint64(0xFFFF_FFFF), np.uint64(32)
_NONE, _ONE, _TWO, _FOUR = np.uint64(0), np.uint64(1), np.uint64(2), np.uint64(4)
_TEN, _FORTY, _HUNDRED = np.uint64(10), np.uint64(40), np.uint64(100)
_FOUR_ZEROS, _EIGHT_ZEROS = np.uint64(10_000), np.uint64(100_000_000)


def _powers_of_ten() -> NDArray[np.uint64]:
    """Give 10ᵏ for each power, as its highest 128 bits, rounded up: two words each."""
    rows = []
    for power in range(FIRST_POWER, _LAST_POWER + 1):
        if power >= 0:
            shift = 128 - (10**power).bit_length()
            value = 10**power << shift if shift >= 0 else -(-(10**power) >> -shift)
        else:
            shift = 127 + (10**-power).bit_length()
            value = -(-(1 << shift) // 10**-power)
        rows.append((value >> 64, value & (2**64 - 1)))
    return np.array(rows, np.uint64)


POWERS = _powers_of_ten()
# Parts of other kernels, not to be called from Python: such names begin with an underscore.


@compiled
def _product_high(a: np.uint64, b: np.uint64) -> np.uint64:
    """Of the 128 bits of a product the upper half."""
    a_low, a_high, b_low, b_high = a & _LOW, a >> _HALF, b & _LOW, b >> _HALF
    across = a_low * b_high
    middle = ((a_low * b_low) >> _HALF) + (across & _LOW) + a_high * b_low
    return a_high * b_high + (across >> _HALF) + (middle >> _HALF)


@compiled
def _scaled(high: np.uint64, low: np.uint64, value: np.uint64) -> np.uint64:
    """Multiply by a power of ten and leave out 128 bits, which the last one stands for."""
    upper, lower = _product_high(high, value), high * value
    total = lower + _product_high(low, value)
    if total < lower:
        upper += _ONE
    return upper | (_ONE if total > _ONE else _NONE)


@compiled
def _shortest(  # noqa: PLR0913, PLR0917 - a float, and its power of ten
    mantissa: int, power_of_two: int, step_below: int, k: int, high: np.uint64, low: np.uint64
) -> tuple[np.uint64, int]:
    """Digits and power of ten for mantissa · 2^power_of_two.

    ``step_below``: 2 where the float below it is as far away as the one above, 1 where it is half
    as far. ``k``: the power of ten below the interval; ``high`` and ``low``: 10⁻ᵏ.
    """
    shift = np.uint64(power_of_two + ((-k * 1_741_647) >> 19) + 1)
    four = np.uint64(4 * mantissa)
    below = _scaled(high, low, (four - np.uint64(step_below)) << shift)
    value = _scaled(high, low, four << shift)
    above = _scaled(high, low, (four + _TWO) << shift)
    if mantissa & 1:  # of a tie the even one reads back
        below += _ONE
        above -= _ONE
    s = value // _FOUR
    if s >= _TEN:
        tens = s // _TEN
        under = below <= _FORTY * tens
        over = _FORTY * tens + _FORTY <= above
        if under != over:
            return tens + (_ONE if over else _NONE), k + 1
    under = below <= _FOUR * s
    over = _FOUR * s + _FOUR <= above
    if under != over:
        return s + (_ONE if over else _NONE), k
    middle = _FOUR * s + _TWO
    up = value > middle or (value == middle and (s & _ONE) == _ONE)
    return s + (_ONE if up else _NONE), k


@compiled
def _stripped(digits: np.uint64, power: int) -> tuple[np.uint64, int]:
    """Without zeros at the end."""
    for step in (8, 4, 2, 1, 1):
        factor = _EIGHT_ZEROS if step == 8 else _FOUR_ZEROS if step == 4 else _HUNDRED  # noqa: PLR2004 - so many zeros
        factor = _TEN if step == 1 else factor
        rest = digits // factor
        if rest * factor == digits:
            digits, power = rest, power + step
    return digits, power


@compiled
def _count_digits(value: np.uint64) -> int:
    """How many it has."""
    count, rest = 1, value
    if rest >= _EIGHT_ZEROS:
        rest //= _EIGHT_ZEROS
        count += 8
        if rest >= _EIGHT_ZEROS:
            rest //= _EIGHT_ZEROS
            count += 8
    if rest >= _FOUR_ZEROS:
        rest //= _FOUR_ZEROS
        count += 4
    if rest >= _HUNDRED:
        rest //= _HUNDRED
        count += 2
    return count + (1 if rest >= _TEN else 0)
