"""The recovery planner ends and rarely leaves a large hole, for random robots in random rooms."""

from __future__ import annotations

import pytest

from campaign.random_robots import random_run

pytestmark = pytest.mark.slow

FINE_SHARE = 0.9
"""Minimum share of runs without a large hole."""


@pytest.mark.timeout(3600)
@pytest.mark.parametrize("count", [10, pytest.param(200, marks=pytest.mark.nightly)])
def test_every_robot_ends_by_itself_and_few_leave_a_hole(count: int) -> None:
    fine = 0
    for seed in range(count):
        run = random_run(seed)
        assert run.finish_reason is not None, f"seed {seed} did not end by itself"
        assert "enclosed" not in run.finish_reason, f"seed {seed}: {run.finish_reason}"
        assert run.mouth_passing > 0.9, f"seed {seed}: {run.mouth_passing:.3f} of the floor"
        fine += run.fine
    assert fine >= FINE_SHARE * count, f"{fine} of {count} without a large hole"
