"""Numbers, times and texts as the cells of a CSV file, compiled."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.compiled import compiled, compiled_unlocked
from bridge.record.shortest_kernel import FIRST_POWER, POWERS
from bridge.record.shortest_kernel import _count_digits as count_digits
from bridge.record.shortest_kernel import _shortest as shortest
from bridge.record.shortest_kernel import _stripped as stripped

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Bytes = NDArray[np.uint8]
    Ints = NDArray[np.int64]

INTEGER, UNSIGNED, DOUBLE, SINGLE, TIME, BOOLEAN, TEXT, HEX, READY = range(9)
"""What a column's cells are: 64-bit patterns, or places of texts, of bytes and of what is written
as it stands."""
WIDEST = 32
"""No cell that is neither a text nor hexadecimal is longer, its comma included, in bytes."""

_SECOND_NS, _DAY_S = 1_000_000_000, 86_400
_QUOTE, _COMMA, _NEWLINE, _RETURN, _ZERO, _MINUS, _POINT = 34, 44, 10, 13, 48, 45, 46
_ZULU = 90
_SECONDS_SIZE = 20
"""Of a time's text, up to its point."""
NAN, INFINITE, TRUE, FALSE, NULL = range(5)
"""Words that stand for what is no number."""
_NONE, _ONE, _TWO = np.uint64(0), np.uint64(1), np.uint64(2)
_TEN, _HUNDRED = np.uint64(10), np.uint64(100)
_INFINITE, _INFINITE_SINGLE = 0x7FF0_0000_0000_0000, 0x7F80_0000
_MOST_PLAIN = 16
"""Digits before the point; what has more is written with an exponent, as Python does."""


_PAIRS = np.frombuffer("".join(f"{i:02}" for i in range(100)).encode(), np.uint8).copy()
"""The numbers from 00 to 99 as texts."""


@compiled
def _put_digits(out: Bytes, at: int, value: np.uint64, count: int) -> int:
    """Write ``count`` digits, zeros in front included; where they end."""
    place, rest = at + count, value
    while place - at >= 2:  # noqa: PLR2004 - two at a time
        upper = rest // _HUNDRED
        pair = 2 * np.int64(rest - upper * _HUNDRED)
        out[place - 2], out[place - 1] = _PAIRS[pair], _PAIRS[pair + 1]
        rest = upper
        place -= 2
    if place > at:
        out[at] = _ZERO + np.int64(rest)
    return at + count


@compiled
def _put_word(out: Bytes, at: int, word: int) -> int:
    """Write one of the words that are no number; where it ends."""
    size = 3
    if word == NAN:
        out[at], out[at + 1], out[at + 2] = 110, 97, 110
    elif word == INFINITE:
        out[at], out[at + 1], out[at + 2] = 105, 110, 102
    elif word == TRUE:
        out[at], out[at + 1], out[at + 2], out[at + 3] = 116, 114, 117, 101
        size = 4
    elif word == NULL:
        out[at], out[at + 1], out[at + 2], out[at + 3] = 110, 117, 108, 108
        size = 4
    else:
        out[at], out[at + 1], out[at + 2], out[at + 3], out[at + 4] = 102, 97, 108, 115, 101
        size = 5
    return at + size


@compiled
def _put_exponent(out: Bytes, at: int, digits: np.uint64, count: int, exponent: int) -> int:
    """Write digits with a point after the first, and an exponent of at least two digits."""
    end = _put_digits(out, at + 1, digits, count)
    out[at] = out[at + 1]
    if count > 1:
        out[at + 1] = _POINT
    else:
        end = at + 1
    out[end], out[end + 1] = 101, _MINUS if exponent < 0 else 43  # e-, e+
    size = np.uint64(abs(exponent))
    return _put_digits(out, end + 2, size, max(2, count_digits(size)))


@compiled
def _put_seconds(out: Bytes, at: int, seconds: int) -> int:
    """Write a time since 1970 in UTC, up to its whole seconds, with a point."""
    days = seconds // _DAY_S
    # Years from March on, in eras of 400 years: the leap day is then the last of its year.
    era, day = (days + 719_468) // 146_097, (days + 719_468) % 146_097
    year = (day - day // 1_460 + day // 36_524 - day // 146_096) // 365
    day -= 365 * year + year // 4 - year // 100
    month = (5 * day + 2) // 153
    day -= (153 * month + 2) // 5 - 1
    month += 3 if month < 10 else -9  # noqa: PLR2004 - January and February
    year += 400 * era + (1 if month <= 2 else 0)  # noqa: PLR2004 - the same
    at = _put_digits(out, at, np.uint64(year), 4)
    of_day = seconds - days * _DAY_S
    parts = (month, day, of_day // 3_600, of_day // 60 % 60, of_day % 60)
    for i in range(5):
        out[at] = _MINUS if i < 2 else 32 if i == 2 else 58  # noqa: PLR2004 - "-", " ", ":"
        at = _put_digits(out, at + 1, np.uint64(parts[i]), 2)
    out[at] = _POINT
    return at + 1


@compiled
def _put_number(  # noqa: C901, PLR0912, PLR0915 - one function: calls that pass arrays cost more than all it does
    out: Bytes, at: int, bits: int, kind: int
) -> int:
    """Write a cell that is no text; where it ends."""
    if kind == BOOLEAN:
        return _put_word(out, at, TRUE if bits else FALSE)
    digits, power, count, is_negative = np.uint64(bits), 0, 0, False
    is_float = kind == DOUBLE or kind == SINGLE  # noqa: PLR1714 - a set would be made
    if kind == INTEGER:
        if bits < 0:
            digits, is_negative = _NONE - digits, True
    elif kind == TIME:
        seconds = bits // _SECOND_NS
        at = _put_seconds(out, at, seconds)
        digits, count = np.uint64(bits - seconds * _SECOND_NS), 9
    elif is_float:
        is_double = kind == DOUBLE
        width, bias, infinite = (52, 1075, 2047) if is_double else (23, 150, 255)
        fraction = bits & ((1 << width) - 1)
        exponent = (bits >> width) & infinite
        is_negative = (((bits >> 63) if is_double else (bits >> 31)) & 1) == 1
        if exponent == infinite:
            if fraction:
                return _put_word(out, at, NAN)
            if is_negative:
                out[at] = _MINUS
                at += 1
            return _put_word(out, at, INFINITE)
        mantissa = fraction | (1 << width) if exponent else fraction
        power_of_two = max(exponent, 1) - bias
        if -width <= power_of_two <= 0 and mantissa & ((1 << -power_of_two) - 1) == 0:
            digits = np.uint64(mantissa >> -power_of_two)
        elif mantissa == 0:
            digits = _NONE
        else:
            step_below = 1 if fraction == 0 and exponent > 1 else 2
            k = (power_of_two * 1_262_611 - (524_031 if step_below == 1 else 0)) >> 22
            high, low = POWERS[-k - FIRST_POWER, 0], POWERS[-k - FIRST_POWER, 1]
            digits, power = shortest(mantissa, power_of_two, step_below, k, high, low)
            digits, power = stripped(digits, power)
    if is_negative:
        out[at] = _MINUS
        at += 1
    if count == 0:
        count = count_digits(digits)
    point = count + power
    begin = at
    if power != 0 or point > _MOST_PLAIN:
        if is_float and (point < -3 or point > _MOST_PLAIN):  # noqa: PLR2004 - 0.0001 is the last plain one
            return _put_exponent(out, at, digits, count, point - 1)
        if point <= 0:
            out[at], out[at + 1] = _ZERO, _POINT
            begin = at + 2
            for _ in range(-point):
                out[begin] = _ZERO
                begin += 1
        elif power < 0:
            begin = at + 1
    # Indexes without a sign, here and below: one that may be negative is looked at twice.
    to, rest = np.uint64(begin + count), digits
    while rest >= _TEN or to > np.uint64(begin + 1):
        upper = rest // _HUNDRED
        pair = _TWO * (rest - upper * _HUNDRED)
        to -= _TWO
        out[to], out[to + _ONE] = _PAIRS[pair], _PAIRS[pair + _ONE]
        rest = upper
    if to > np.uint64(begin):
        out[begin] = _ZERO + np.int64(rest)
    end = begin + count
    if power < 0 < point:
        for i in range(at, at + point):
            out[i] = out[i + 1]
        out[at + point] = _POINT
    for _ in range(power):
        out[end] = _ZERO
        end += 1
    if kind == TIME:
        out[end] = _ZULU
        end += 1
    return end


@compiled
def _copy(out: Bytes, at: int, source: Bytes, start: int, end: int) -> int:
    """Copy bytes; where they end."""
    size, to, begin = np.uint64(end - start), np.uint64(at), np.uint64(start)
    for i in range(size):
        out[to + i] = source[begin + i]
    return at + end - start


@compiled
def _repeat(out: Bytes, begin: int, end: int, times: int) -> int:
    """Have a stretch so many times in all, one after the other; where the last one ends."""
    start, done = np.uint64(begin), np.uint64(end - begin)
    whole = done * np.uint64(times)
    while done < whole:  # what is there by now is copied: each time twice as much
        size = min(done, whole - done)
        for i in range(size):
            out[start + done + i] = out[start + i]
        done += size
    return begin + int(whole)


@compiled
def _put_text(out: Bytes, at: int, text: Bytes, start: int, end: int) -> int:
    """Write a text, quoted where it must be; the empty one is, as nothing at all is a null."""
    size, begin = np.uint64(end - start), np.uint64(start)
    special = size == _NONE
    for i in range(size):
        c = text[begin + i]
        special |= (c == _QUOTE) | (c == _COMMA) | (c == _NEWLINE) | (c == _RETURN)
    if not special:
        return _copy(out, at, text, start, end)
    out[at] = _QUOTE
    at += 1
    for i in range(size):
        out[at] = text[begin + i]
        at += 1
        if text[begin + i] == _QUOTE:
            out[at] = _QUOTE
            at += 1
    out[at] = _QUOTE
    return at + 1


@compiled
def _put_hex(out: Bytes, at: int, text: Bytes, start: int, end: int) -> int:
    to, size, begin = np.uint64(at), np.uint64(end - start), np.uint64(start)
    for i in range(size):
        byte = text[begin + i]
        high, low = byte >> 4, byte & 15
        out[to + _TWO * i] = high + (_ZERO if high < 10 else 87)  # noqa: PLR2004 - then letters
        out[to + _TWO * i + _ONE] = low + (_ZERO if low < 10 else 87)  # noqa: PLR2004 - the same
    return at + 2 * (end - start)


@compiled_unlocked
def put_rows(  # noqa: PLR0913, PLR0917 - columns, texts, tables, and a place
    kinds: Ints,
    bits: Ints,
    known: Bytes,
    text: Bytes,
    places: Ints,
    first: int,
    last: int,
    before: Ints,
    out: Bytes,
) -> int:
    """Write rows as lines of CSV; how many bytes they take.

    Args:
        kinds: Of each column.
        bits: By column and row. Of a text where its place stands in ``places``; its end is the
            next one there.
        known: By column and row; 0 leaves the cell empty.
        text: All texts and bytes.
        places: Where in ``text`` each begins.
        first: The first row.
        last: The row to end before.
        before: Room for four numbers a column; zeros.
        out: Long enough: ``WIDEST`` for each cell, twice its length and three for a text.

    """
    at, columns = 0, len(kinds)
    for row in range(first, last):
        for column in range(columns):
            kind, value = kinds[column], bits[column, row]
            if not known[column, row]:
                pass
            elif kind >= TEXT:
                start, end = places[value], places[value + 1]
                if kind == TEXT:
                    at = _put_text(out, at, text, start, end)
                elif kind == READY:
                    at = _copy(out, at, text, start, end)
                else:
                    at = _put_hex(out, at, text, start, end)
            elif row > first and value == before[0, column] and before[2, column]:
                begin = before[1, column]
                at = _copy(out, at, out, begin, begin + before[2, column])
            elif kind == TIME and value // _SECOND_NS == before[3, column] and before[2, column]:
                begin = before[1, column]
                at = _copy(out, at, out, begin, begin + _SECONDS_SIZE)
                at = _put_digits(out, at, np.uint64(value % _SECOND_NS), 9)
                out[at] = _ZULU
                at += 1
            else:
                end = _put_number(out, at, value, kind)
                before[0, column], before[1, column], before[2, column] = value, at, end - at
                before[3, column] = value // _SECOND_NS
                at = end
            out[at] = _COMMA
            at += 1
        out[at - 1] = _NEWLINE
    return at


@compiled_unlocked
def put_lists(
    kind: int,
    bits: Ints,
    offsets: Ints,
    places: Ints,
    out: Bytes,
) -> int:
    """Write lists of numbers as JSON, quoted where CSV needs it; how many bytes they take.

    Args:
        kind: Of their values.
        bits: The values of all lists.
        offsets: Where in them each list begins, and the last one ends.
        places: Filled with where in ``out`` each text begins, and the last one ends.
        out: Long enough: ``WIDEST`` for each value, four for a list.

    """
    at, is_float = 0, kind == DOUBLE or kind == SINGLE  # noqa: PLR1714 - a set would be made
    infinite = _INFINITE if kind == DOUBLE else _INFINITE_SINGLE
    for row in range(len(offsets) - 1):
        places[row] = at
        is_quoted = offsets[row + 1] - offsets[row] > 1
        if is_quoted:
            out[at] = _QUOTE
            at += 1
        out[at] = 91  # [
        at += 1
        first, end = np.uint64(offsets[row]), np.uint64(offsets[row + 1])
        while first < end:
            begin, value = at, bits[first]
            # JSON has neither NaN nor infinity.
            if is_float and value & infinite == infinite:
                at = _put_word(out, at, NULL)
            else:
                at = _put_number(out, at, value, kind)
            out[at] = _COMMA
            at += 1
            last = first + _ONE
            while last < end and bits[last] == value:  # most of a map
                last += _ONE
            at = _repeat(out, begin, at, int(last - first))
            first = last
        if offsets[row + 1] > offsets[row]:
            at -= 1
        out[at] = 93  # ]
        at += 1
        if is_quoted:
            out[at] = _QUOTE
            at += 1
    places[len(offsets) - 1] = at
    return at


def rehearse() -> None:
    """Compile, or load what was compiled, before it is needed."""
    number, two, out = np.zeros(1, np.int64), np.zeros(2, np.int64), np.empty(2 * WIDEST, np.uint8)
    put_lists(DOUBLE, number, two, two.copy(), out)
    cells, known, before = np.zeros((1, 1), np.int64), np.ones((1, 1), np.uint8), np.zeros((4, 1))
    put_rows(number, cells, known, known[0], two, 0, 1, before.astype(np.int64), out)
