"""The latched stop: the most severe cause, and the command that clears it."""

from __future__ import annotations

import itertools

import pytest

from protocol.messages.values import StopCause
from sim_device.device.latch import StopLatch

CAUSES = [c for c in StopCause if c is not StopCause.NONE]


def test_a_device_boots_latched() -> None:
    assert StopLatch().cause is StopCause.SESSION_END
    assert StopLatch().latched


@pytest.mark.parametrize(("held", "new"), list(itertools.product(StopCause, CAUSES)))
def test_the_graver_cause_holds(held: StopCause, new: StopCause) -> None:
    latch = StopLatch(held)
    assert latch.latch(new) is (new > held)
    assert latch.cause is max(held, new)
    assert latch.latched


@pytest.mark.parametrize(("held", "named"), list(itertools.product(CAUSES, range(8))))
def test_only_the_cause_that_holds_can_be_cleared(held: StopCause, named: int) -> None:
    latch = StopLatch(held)
    assert latch.clear(named) is (named == held)
    assert latch.cause is (StopCause.NONE if named == held else held)


def test_without_a_latch_there_is_nothing_to_clear() -> None:
    latch = StopLatch(StopCause.NONE)
    assert not latch.clear(StopCause.NONE)
    assert not latch.latched


def test_a_latch_begins_with_an_orderly_end_and_none_is_free() -> None:
    latch = StopLatch()
    assert (latch.cause, latch.latched) == (StopCause.SESSION_END, True)
    assert latch.latch(StopCause.SESSION_END) is False
    assert latch.latch(StopCause.OPERATOR) is True
    assert latch.latch(StopCause.SUPERVISE) is False
    assert latch.clear(StopCause.SUPERVISE) is False
    assert latch.cause is StopCause.OPERATOR
    assert latch.clear(StopCause.OPERATOR) is True
    assert (latch.cause, latch.latched) == (StopCause.NONE, False)
    assert latch.clear(StopCause.NONE) is False
