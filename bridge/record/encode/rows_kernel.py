"""Compiled conversion of rows of numbers to records of fixed length."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cython
import numpy as np
from cython.cimports.libc.math import cos, sin

if TYPE_CHECKING or cython.compiled:
    from cython.cimports.bridge.motion.arrays import (
        Bytes,
        FloatGrid,
        Floats,
        LongBlock,
        LongGrid,
        Longs,
        Singles,
    )

_WHOLE = cython.declare(cython.int, 0)
_SECONDS = cython.declare(cython.int, 1)
_NANOSECONDS = cython.declare(cython.int, 2)
_STAMP = cython.declare(cython.int, 3)
_SCALED = cython.declare(cython.int, 4)
_FLOAT = cython.declare(cython.int, 10)
_SIN_HALF = cython.declare(cython.int, 11)
_COS_HALF = cython.declare(cython.int, 12)
# Kinds of values that are computed from an integer column.
WHOLE, SECONDS, NANOSECONDS, STAMP, SCALED = _WHOLE, _SECONDS, _NANOSECONDS, _STAMP, _SCALED
# Kinds of values that are computed from a float column.
FLOAT, SIN_HALF, COS_HALF = _FLOAT, _SIN_HALF, _COS_HALF
_NS = cython.declare(cython.longlong, 1_000_000_000)


@cython.final
@cython.cclass
class _Reals:
    """Float buffers with byte views of the same memory, in native byte order."""

    double: Floats
    double_bytes: Bytes
    single: Singles
    single_bytes: Bytes

    def __init__(self) -> None:
        """Allocate one float of each width."""
        double, single = np.zeros(1), np.zeros(1, dtype=np.float32)
        self.double, self.double_bytes = double, double.view(np.uint8)
        self.single, self.single_bytes = single, single.view(np.uint8)


@cython.cfunc
@cython.exceptval(check=False)
def _put(out: Bytes, at: cython.longlong, value: cython.longlong, width: cython.int) -> cython.void:
    for k in range(width):
        out[at + k] = (value >> (8 * k)) & 0xFF


@cython.cfunc
@cython.cdivision(False)  # noqa: FBT003 - a directive: remainders are never negative
@cython.exceptval(check=False)
def _put_stamp(out: Bytes, at: cython.longlong, time_ns: cython.longlong) -> cython.void:
    """Write a ``google.protobuf.Timestamp`` of twelve bytes with padded varints."""
    out[at], out[at + 6] = 0x08, 0x10
    value: cython.longlong
    for half in range(2):
        value = time_ns // _NS if half == 0 else time_ns % _NS
        for k in range(5):
            more = 0x80 if k < 4 else 0  # noqa: PLR2004 - the fifth byte is the last
            out[at + 1 + 6 * half + k] = ((value >> (7 * k)) & 0x7F) | more


@cython.cfunc
@cython.exceptval(check=False)
def _put_real(
    out: Bytes, at: cython.longlong, value: cython.double, width: cython.int, reals: _Reals
) -> cython.void:
    if width == 4:  # noqa: PLR2004 - bytes of a single
        reals.single[0] = value
        for k in range(4):
            out[at + k] = reals.single_bytes[k]
    else:
        reals.double[0] = value
        for k in range(8):
            out[at + k] = reals.double_bytes[k]


@cython.cfunc
@cython.cdivision(False)  # noqa: FBT003 - a directive: remainders are never negative
@cython.exceptval(check=False)
def _put_value(  # noqa: PLR0913, PLR0917 - a row, an operation and an offset
    ints: LongGrid,
    floats: FloatGrid,
    row: cython.Py_ssize_t,
    ops: LongGrid,
    scales: FloatGrid,
    op: cython.Py_ssize_t,
    start: cython.longlong,
    out: Bytes,
    reals: _Reals,
) -> cython.void:
    at, kind, column, width = start + ops[op, 0], ops[op, 1], ops[op, 2], ops[op, 3]
    if kind == _WHOLE:
        _put(out, at, int(ints[row, column]), width)
    elif kind == _SECONDS:
        _put(out, at, int(ints[row, column] // _NS), width)
    elif kind == _NANOSECONDS:
        _put(out, at, int(ints[row, column] % _NS), width)
    elif kind == _STAMP:
        _put_stamp(out, at, int(ints[row, column]))
    elif kind == _SCALED:
        gain, offset = scales[op, 0], scales[op, 1]
        _put_real(out, at, ints[row, column] * gain + offset, width, reals)
    elif kind == _SIN_HALF:
        _put_real(out, at, sin(0.5 * floats[row, column]), width, reals)
    elif kind == _COS_HALF:
        _put_real(out, at, cos(0.5 * floats[row, column]), width, reals)
    else:
        _put_real(out, at, floats[row, column], width, reals)


def pack_rows(  # noqa: PLR0913, PLR0917 - the arrays of the kernel
    ints: LongGrid,
    floats: FloatGrid,
    template: Bytes,
    ops: LongGrid,
    scales: FloatGrid,
    out: Bytes,
    log_column: cython.Py_ssize_t,
    places: Longs,
    index: LongBlock,
) -> tuple[int, int]:
    """Write a record for each row, and the index of its messages.

    Args:
        ints: Rows of integers, ``(n, columns)``. The first column is the offset in ``out`` at which
            the row's record is written.
        floats: Rows of floats, ``(n, columns)``.
        template: One record with its constants.
        ops: For each value: offset in the record, kind, column, width in bytes.
        scales: For each value: gain and offset.
        out: The chunk, with space for the rows' records.
        log_column: Column of the log time.
        places: Offset of each message in a record, ``(messages,)``.
        index: Filled with each message's log times and offsets, ``(messages, n, 2)``.

    Returns:
        The minimum and the maximum log time.

    """
    reals = _Reals()
    first: cython.longlong = ints[0, log_column]
    last: cython.longlong = first
    begin: cython.longlong
    time: cython.longlong
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
            _put_value(ints, floats, row, ops, scales, op, begin, out, reals)
    return int(first), int(last)
