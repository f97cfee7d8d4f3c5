"""The C firmware and the Python one on the same bytes, readings and times: equal, byte for byte.

Both implement the same specification. A difference is an error of one of them, or a gap in the
specification.
"""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.kit_compare import compare
from support.kit_sessions import FAIR, HOSTILE, SENSED, write

pytestmark = pytest.mark.slow

EXAMPLES = settings().max_examples // 2
"""Number of examples, half of the profile's: 50, and 2500 in a search."""


@settings(max_examples=EXAMPLES)
@given(deeds=st.lists(st.one_of(FAIR, SENSED), max_size=50))
def test_sessions(deeds: list[Any]) -> None:
    compare(write(deeds))


@settings(max_examples=EXAMPLES)
@given(deeds=st.lists(st.one_of(FAIR, HOSTILE), max_size=50), begun=st.booleans())
def test_hostile_sessions(deeds: list[Any], *, begun: bool) -> None:
    compare(write(deeds, begun=begun))


@settings(max_examples=EXAMPLES // 2)
@given(deeds=st.lists(st.one_of(FAIR, SENSED), max_size=50))
def test_sessions_on_can(deeds: list[Any]) -> None:
    compare(write(deeds, can=True), can=True)
