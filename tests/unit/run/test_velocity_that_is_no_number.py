"""A NaN velocity or duty raises an error, because no comparison with a limit rejects it."""

from __future__ import annotations

import math

import pytest

from bridge.session.outbox import Outbox
from protocol.clock import HostNs
from protocol.schema.message import Direction
from protocol.uart.link import Link
from tools.virtual.settings import SweeperSettings
from tools.virtual.simulated_sweeper import SimulatedSweeper

BAD = [(math.nan, 0.0), (0.0, math.nan)]


@pytest.mark.parametrize("pair", BAD)
def test_nothing_is_queued(pair: tuple[float, float]) -> None:
    link = Link(Direction.HOST)
    outbox = Outbox(link, None)
    with pytest.raises(ValueError, match="velocity is not a number"):
        outbox.setpoint(*pair, 200, HostNs(0))
    with pytest.raises(ValueError, match="duty is not a number"):
        outbox.duty(*pair, 200, HostNs(0))
    assert link.data_to_send() == b""


@pytest.mark.parametrize("pair", BAD)
def test_no_robot_moves_for_it(pair: tuple[float, float]) -> None:
    sweeper = SimulatedSweeper(SweeperSettings(room="empty"))
    sweeper.enable()
    before = sweeper.truth
    with pytest.raises(ValueError, match="velocity is not a number"):
        sweeper.drive(*pair, for_s=1.0)
    after = sweeper.truth
    assert (after.pose, after.collisions) == (before.pose, before.collisions)
