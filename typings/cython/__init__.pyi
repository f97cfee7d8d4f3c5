"""What our kernels use of Cython's pure-Python mode; mypy sees C's numbers as Python's."""

import builtins
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Literal, Protocol, TypeAlias, TypeVar, overload

_Value = TypeVar("_Value")
_Function = TypeVar("_Function", bound=Callable[..., object])
_Class = TypeVar("_Class", bound=builtins.type)

double: TypeAlias = builtins.float
int: TypeAlias = builtins.int
longlong: TypeAlias = builtins.int
ulonglong: TypeAlias = builtins.int
uchar: TypeAlias = builtins.int
Py_ssize_t: TypeAlias = builtins.int
bint: TypeAlias = builtins.bool
void: TypeAlias = None

compiled: builtins.bool

@overload
def declare(kind: builtins.type[_Value], value: _Value) -> _Value: ...
@overload
def declare(
    kind: builtins.type[_Value], *, visibility: Literal["public", "readonly"]
) -> _Value: ...
def cast(kind: builtins.type[_Value], value: object) -> _Value: ...
def cclass(kind: _Class) -> _Class: ...
def final(kind: _Class) -> _Class: ...
def cfunc(function: _Function) -> _Function: ...
def ccall(function: _Function) -> _Function: ...
def exceptval(*, check: builtins.bool) -> Callable[[_Function], _Function]: ...
def boundscheck(on: builtins.bool, /) -> Callable[[_Function], _Function]: ...
def wraparound(on: builtins.bool, /) -> Callable[[_Function], _Function]: ...
def cdivision(on: builtins.bool, /) -> Callable[[_Function], _Function]: ...

class _NoGil(AbstractContextManager[None], Protocol):
    def __call__(self, function: _Function, /) -> _Function: ...

nogil: _NoGil
