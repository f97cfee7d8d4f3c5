"""The fixture of the device under test."""

from __future__ import annotations

import pytest


@pytest.fixture
def device(request: pytest.FixtureRequest) -> str:
    """Return the name of the port or emulated link; the check gets a probe connected to it."""
    name: str = request.param
    return name
