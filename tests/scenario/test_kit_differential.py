"""The C firmware and the Python one on the same bytes, readings and times: equal, byte for byte.

Both are the same device by the specification, written twice by the same people: what one of them
does and the other does not is a fault of one, or a gap in the specification.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.kit_build import Kit, build_kit
from support.kit_script import frames
from support.kit_sessions import FAIR, HOSTILE, SENSED, write
from support.kit_twin import Twin

if TYPE_CHECKING:
    from support.kit_script import Act

EXAMPLES = settings().max_examples // 2
"""Of the profile's: 50, and 2500 in a search."""


@pytest.fixture(scope="module")
def kit(tmp_path_factory: pytest.TempPathFactory) -> Kit:
    return build_kit(tmp_path_factory.mktemp("kit"))


def compare(kit: Kit, acts: list[Act], *, can: bool = False) -> None:
    """Both on a script: what they were and what they wrote after each step."""
    ours, twins = kit.run(acts), Twin().run(acts)
    assert len(ours) == len(twins)
    for number, (c, python) in enumerate(zip(ours, twins, strict=True)):
        assert frames(c.wrote, can=can) == frames(python.wrote, can=can), number
        assert c._replace(wrote=b"", motors=(0, 0)) == python._replace(wrote=b"", motors=(0, 0))
        # Single against double precision: a step of a ten-thousandth.
        assert c.motors == pytest.approx(python.motors, abs=1), number


@settings(max_examples=EXAMPLES)
@given(deeds=st.lists(st.one_of(FAIR, SENSED), max_size=50))
def test_sessions(kit: Kit, deeds: list[Any]) -> None:
    compare(kit, write(deeds))


@settings(max_examples=EXAMPLES)
@given(deeds=st.lists(st.one_of(FAIR, HOSTILE), max_size=50), begun=st.booleans())
def test_hostile_sessions(kit: Kit, deeds: list[Any], *, begun: bool) -> None:
    compare(kit, write(deeds, begun=begun))


@settings(max_examples=EXAMPLES // 2)
@given(deeds=st.lists(st.one_of(FAIR, SENSED), max_size=50))
def test_sessions_on_can(kit: Kit, deeds: list[Any]) -> None:
    compare(kit, write(deeds, can=True), can=True)
