"""What installation compiles is all that a run would compile later."""

from __future__ import annotations

from tools import warm


def test_each_kernel_that_is_called_from_python_is_called() -> None:
    warm.warm()
    # Those with an underscore are compiled into the others.
    entries = {k.__name__: k for k in warm.kernels() if not k.__name__.startswith("_")}
    assert {"advance", "sample", "cast_beams", "climb", "carpet_under", "sweep"} <= set(entries)
    assert [name for name, kernel in entries.items() if not kernel.signatures] == []


def test_each_is_compiled_for_one_kind_of_arguments() -> None:
    """Another layout of an array or an int for a float would be compiled anew, in each run."""
    warm.warm()
    assert [k.__name__ for k in warm.kernels() if len(k.signatures) > 1] == []
