"""Compiled kernels: loops over floats and grids, as machine code that is kept between runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, ParamSpec, TypeVar, cast

from numba import njit

if TYPE_CHECKING:
    from collections.abc import Callable

_Args = ParamSpec("_Args")
_Result = TypeVar("_Result")


def compiled(kernel: Callable[_Args, _Result]) -> Callable[_Args, _Result]:
    """Compile a function of numbers and numpy arrays at its first call, and keep the code.

    The code is kept beside the module (or, where that cannot be written, in the user's
    cache), so only the first run ever pays for it; ``make`` pays at installation. Without
    ``fastmath``: equal input gives equal floats.
    """
    return cast("Callable[_Args, _Result]", njit(cache=True)(kernel))
