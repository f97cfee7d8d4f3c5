"""What installation compiles is all that a run would compile later."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from support.cli import ROOT

LIST = """
import json
from numba.core.types import unliteral
from tools import warm
warm.warm()
def kinds(kernel):  # one for each constant that another kernel hands over is the same kind
    return len({tuple(map(unliteral, signature)) for signature in kernel.signatures})
print(json.dumps({kernel.__name__: kinds(kernel) for kernel in warm.kernels()}))
"""


@pytest.fixture(scope="module")
def kernels() -> dict[str, int]:
    """Kinds of arguments that each kernel was compiled for, in a process that only warms up."""
    done = subprocess.run(
        [sys.executable, "-c", LIST], cwd=ROOT, capture_output=True, text=True, check=True
    )
    found: dict[str, int] = json.loads(done.stdout)
    return found


def test_each_kernel_that_is_called_from_python_is_called(kernels: dict[str, int]) -> None:
    # Those with an underscore are compiled into the others.
    entries = {name: kinds for name, kinds in kernels.items() if not name.startswith("_")}
    assert {"advance", "sample", "cast_beams", "climb", "carpet_under", "sweep"} <= set(entries)
    assert [name for name, kinds in entries.items() if not kinds] == []


def test_each_is_compiled_for_one_kind_of_arguments(kernels: dict[str, int]) -> None:
    """Another layout of an array or an int for a float would be compiled anew, in each run."""
    assert [name for name, kinds in kernels.items() if kinds > 1] == []
