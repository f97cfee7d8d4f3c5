"""Selection of tests: a ``nightly`` test has a smaller version that `make test` runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from _pytest.mark.structures import ParameterSet


def seeds(always: int, nightly: int, *, first: int = 0) -> list[ParameterSet]:
    """Return seeds: the first ``always`` for every run, the others only for `make nightly`."""
    marks = [()] * always + [(pytest.mark.nightly,)] * nightly
    return [pytest.param(first + number, marks=mark) for number, mark in enumerate(marks)]
