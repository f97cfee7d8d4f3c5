"""Rows of numbers as records of fixed length, compiled: a template and what goes where in it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bridge.motion.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Bytes = NDArray[np.uint8]
    Ints = NDArray[np.int64]
    Floats = NDArray[np.float64]

# What is written from an integer column, ...
WHOLE, SECONDS, NANOSECONDS, STAMP, SCALED = range(5)
# ... and what from a column of floats.
FLOAT, SIN_HALF, COS_HALF = range(10, 13)
_NS = 1_000_000_000
_SINGLE_BYTES = 4
_DOUBLE_BYTES = 8


@compiled
def _put(out: Bytes, at: int, value: int, width: int) -> None:
    for k in range(width):
        out[at + k] = (value >> (8 * k)) & 0xFF


@compiled
def _put_stamp(out: Bytes, at: int, time_ns: int) -> None:
    """``google.protobuf.Timestamp`` in twelve bytes: all but the fifth say "more follows"."""
    out[at], out[at + 6] = 0x08, 0x10
    for half in range(2):
        value = time_ns // _NS if half == 0 else time_ns % _NS
        for k in range(5):
            more = 0x80 if k < 4 else 0  # noqa: PLR2004 - the fifth ends it
            out[at + 1 + 6 * half + k] = ((value >> (7 * k)) & 0x7F) | more


@compiled
def _put_value(  # noqa: PLR0913, PLR0917 - a row, an operation and a place
    ints: Ints, floats: Floats, op: Ints, scale: Floats, start: int, out: Bytes
) -> None:
    at, kind, column, width = start + op[0], op[1], op[2], op[3]
    if kind == WHOLE:
        _put(out, at, ints[column], width)
    elif kind == SECONDS:
        _put(out, at, ints[column] // _NS, width)
    elif kind == NANOSECONDS:
        _put(out, at, ints[column] % _NS, width)
    elif kind == STAMP:
        _put_stamp(out, at, ints[column])
    else:
        value = _real(ints, floats, kind, column, scale)
        if width == _SINGLE_BYTES:
            _put(out, at, _bits_of_single(value), _SINGLE_BYTES)
        else:
            _put(out, at, _bits_of_double(value), _DOUBLE_BYTES)


@compiled
def _real(ints: Ints, floats: Floats, kind: int, column: int, scale: Floats) -> float:
    if kind == SCALED:
        return float(ints[column] * scale[0] + scale[1])
    value = floats[column]
    if kind == SIN_HALF:
        value = math.sin(0.5 * value)
    elif kind == COS_HALF:
        value = math.cos(0.5 * value)
    return float(value)


@compiled
def _bits_of_single(value: float) -> int:
    return np.float32(value).view(np.int32)  # type: ignore[return-value]  # an int when compiled


@compiled
def _bits_of_double(value: float) -> int:
    return np.float64(value).view(np.int64)  # type: ignore[return-value]  # as above


@compiled
def pack_rows(  # noqa: PLR0913, PLR0917 - the arrays of the kernel
    ints: Ints,
    floats: Floats,
    template: Bytes,
    ops: Ints,
    scales: Floats,
    out: Bytes,
    log_column: int,
    places: Ints,
    index: Ints,
) -> tuple[int, int]:
    """Write a record for each row, and the index of where its messages are.

    Args:
        ints: Rows of integers, ``(n, columns)``; the first is where the row's records begin.
        floats: Rows of floats, ``(n, columns)``.
        template: One record, its constants in place.
        ops: For each value: place in the record, kind, column, width in bytes.
        scales: For each value: gain and offset.
        out: The chunk, in which the rows' places are still empty.
        log_column: Column of the log time.
        places: Where each message begins in a record, ``(messages,)``.
        index: Room for each message's log times and places, ``(messages, n, 2)``.

    Returns:
        The least and the greatest log time.

    """
    first = last = ints[0, log_column]
    size = template.shape[0]
    for row in range(ints.shape[0]):
        begin = ints[row, 0]
        time = ints[row, log_column]
        first, last = min(first, time), max(last, time)
        for message in range(places.shape[0]):
            index[message, row, 0] = time
            index[message, row, 1] = begin + places[message]
        for k in range(size):
            out[begin + k] = template[k]
        for op in range(ops.shape[0]):
            _put_value(ints[row], floats[row], ops[op], scales[op], begin, out)
    return first, last
