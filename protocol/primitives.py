"""Small operations on each message, for speed in compiled code.

Each function also has a C version in ``primitives.pxd``. Compiled code uses the C version only in
calls such as ``primitives.make(...)``. With ``from protocol.primitives import make``, compiled code
would call the slower Python function.
"""

from __future__ import annotations

from typing import Any, TypeVar

T = TypeVar("T")


def make(cls: type[T], values: tuple[Any, ...]) -> T:
    """Return an instance of a subclass of ``tuple`` without calling its ``__new__``."""
    return tuple.__new__(cls, values)  # type: ignore[type-var]  # a tuple


def values_of(instance: Any) -> tuple[Any, ...]:  # noqa: ANN401 - any tuple
    """Return the values of an instance of a subclass of ``tuple``, as a plain tuple."""
    return instance[:]  # type: ignore[no-any-return]


def cut(buffer: bytearray, begin: int, end: int) -> bytes:
    """Return a copy of the bytes from ``begin`` to before ``end``."""
    return bytes(buffer[begin:end])
