"""Steps of every message that compiled code takes without a call of Python.

Beside each stands its twin in ``primitives.pxd``. Call them as ``primitives.make(...)``: a name
that is imported from here would be the Python function in compiled code, too.
"""

from __future__ import annotations

from typing import Any, TypeVar

T = TypeVar("T")


def make(cls: type[T], values: tuple[Any, ...]) -> T:
    """An instance of a subclass of ``tuple``; its ``__new__`` is passed over."""
    return tuple.__new__(cls, values)  # type: ignore[type-var]  # a tuple


def values_of(instance: Any) -> tuple[Any, ...]:  # noqa: ANN401 - any tuple
    """The values of an instance of a subclass of ``tuple``, as a plain one."""
    return instance[:]  # type: ignore[no-any-return]


def cut(buffer: bytearray, begin: int, end: int) -> bytes:
    """Some bytes of a buffer, copied."""
    return bytes(buffer[begin:end])
