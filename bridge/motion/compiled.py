"""Compiled kernels: loops over floats and grids, as machine code that is kept between runs."""

from __future__ import annotations

import contextlib
import sys
from typing import TYPE_CHECKING, ParamSpec, TypeVar, cast

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@contextlib.contextmanager
def _left_out(*names: str) -> Iterator[None]:
    """Let nobody import these packages meanwhile, unless somebody has before."""
    hidden = [name for name in names if name not in sys.modules]
    for name in hidden:
        sys.modules[name] = None  # type: ignore[assignment]  # what says "do not look for it"
    try:
        yield
    finally:
        for name in hidden:
            del sys.modules[name]


# Numba tries for all three as it starts, a quarter of a whole start-up: for the coverage of its
# own compiler, for products of matrices, of which the kernels have none, and for a file of
# settings, which its environment variables replace.
with _left_out("coverage", "scipy", "yaml"):
    import numba.np.arraymath  # noqa: F401 - what the first kernel would bring in
    from numba import njit

_Args = ParamSpec("_Args")
_Result = TypeVar("_Result")


def compiled(kernel: Callable[_Args, _Result]) -> Callable[_Args, _Result]:
    """Compile a function of numbers and numpy arrays at its first call, and keep the code.

    The code is kept beside the module (or, where that cannot be written, in the user's
    cache), so only the first run ever pays for it; ``make`` pays at installation. Without
    ``fastmath``: equal input gives equal floats.
    """
    return cast("Callable[_Args, _Result]", njit(cache=True)(kernel))
