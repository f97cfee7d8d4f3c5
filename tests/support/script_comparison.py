"""Runs the C and the Python firmware on one script: their output must be equal, byte for byte."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from support.core_build import script_board
from support.script_format import frames
from support.scripted_model import ScriptedModel

if TYPE_CHECKING:
    from support.script_format import Act, Reported


def compare(acts: list[Act], *, can: bool = False) -> list[Reported]:
    """Run both firmwares and compare their state and output after each step.

    Returns the reports of the C firmware.
    """
    cores, models = script_board().run(acts), ScriptedModel().run(acts)
    assert len(cores) == len(models)
    for number, (core, model) in enumerate(zip(cores, models, strict=True)):
        assert frames(core.wrote, can=can) == frames(model.wrote, can=can), number
        assert core._replace(wrote=b"", motors=(0, 0)) == model._replace(wrote=b"", motors=(0, 0))
        # The C core computes in single precision and the Python model in double precision. So a
        # duty may differ by one step, 1/10 000.
        assert core.motors == pytest.approx(model.motors, abs=1), number
    return cores
