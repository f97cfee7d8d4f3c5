"""The device that is checked."""

from __future__ import annotations

import pytest


@pytest.fixture
def device(request: pytest.FixtureRequest) -> str:
    """Return the name of the port or of the emulated link; the check gets a probe on it."""
    name: str = request.param
    return name
