"""Steps of every message that compiled code runs without a Python call.

Each function has a twin in ``primitives.pxd``. Call them as ``primitives.make(...)``: a name
imported from here would be the Python function in compiled code, too.
"""

from __future__ import annotations

from typing import Any, TypeVar

T = TypeVar("T")


def make(cls: type[T], values: tuple[Any, ...]) -> T:
    """Return an instance of a subclass of ``tuple`` without calling its ``__new__``."""
    return tuple.__new__(cls, values)  # type: ignore[type-var]  # a tuple


def values_of(instance: Any) -> tuple[Any, ...]:  # noqa: ANN401 - any tuple
    """Return the values of an instance of a subclass of ``tuple``, as a plain one."""
    return instance[:]  # type: ignore[no-any-return]


def cut(buffer: bytearray, begin: int, end: int) -> bytes:
    """Return a copy of some bytes of a buffer."""
    return bytes(buffer[begin:end])
