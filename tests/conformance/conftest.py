"""The device that a check is about."""

from __future__ import annotations

import pytest


@pytest.fixture
def device(request: pytest.FixtureRequest) -> str:
    """Name of the port or of the emulated link; the check itself is given a probe on it."""
    name: str = request.param
    return name
