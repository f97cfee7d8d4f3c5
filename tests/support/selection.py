"""Which tests a run leaves out: ``nightly`` on what `make test` has a smaller version of."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from _pytest.mark.structures import ParameterSet


def seeds(always: int, nightly: int, *, first: int = 0) -> list[ParameterSet]:
    """Seeds from ``first`` on: so many in every run, so many more in `make nightly`."""
    marks = [()] * always + [(pytest.mark.nightly,)] * nightly
    return [pytest.param(first + number, marks=mark) for number, mark in enumerate(marks)]
