"""Runs the C and the Python firmware on one script: their output must be equal, byte for byte."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from support.kit_build import the_kit
from support.kit_script import frames
from support.kit_twin import Twin

if TYPE_CHECKING:
    from support.kit_script import Act, Reported


def compare(acts: list[Act], *, can: bool = False) -> list[Reported]:
    """Run both firmwares and compare their state and output after each step.

    Returns the reports of the C firmware.
    """
    ours, twins = the_kit().run(acts), Twin().run(acts)
    assert len(ours) == len(twins)
    for number, (c, python) in enumerate(zip(ours, twins, strict=True)):
        assert frames(c.wrote, can=can) == frames(python.wrote, can=can), number
        assert c._replace(wrote=b"", motors=(0, 0)) == python._replace(wrote=b"", motors=(0, 0))
        # The C core computes in single precision and the Python model in double precision. So a
        # duty may differ by one step, 1/10 000.
        assert c.motors == pytest.approx(python.motors, abs=1), number
    return ours
