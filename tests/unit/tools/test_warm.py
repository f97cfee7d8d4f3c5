"""What installation compiles is all that a run would compile later."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from support.root import ROOT

LIST = """
import json
from tools.dev import warm
warm.warm()
print(json.dumps({kernel.name: kernel.kinds for kernel in warm.kernels().values()}))
"""


@pytest.fixture(scope="module")
def kernels() -> dict[str, list[str] | None]:
    """Kinds of arguments that each kernel was compiled for, in a process that only warms up."""
    done = subprocess.run(
        [sys.executable, "-c", LIST], cwd=ROOT, capture_output=True, text=True, check=True
    )
    found: dict[str, list[str] | None] = json.loads(done.stdout)
    return found


def test_each_kernel_that_is_called_from_python_is_called(
    kernels: dict[str, list[str] | None],
) -> None:
    # Those with an underscore are compiled into the others.
    entries = {name: kinds for name, kinds in kernels.items() if "._" not in name}
    short = {name.rpartition(".")[2] for name in entries}
    assert {"advance", "cast_beams", "climb", "carpet_under", "sweep", "travel"} <= short
    assert [name for name, kinds in entries.items() if kinds is None] == []
