"""A fixed part of the corruption campaign; ``make campaign`` runs all of it."""

from __future__ import annotations

from campaign.corruption import Hit, campaign


def test_damage_lets_nothing_wrong_in_and_costs_hardly_a_neighbour() -> None:
    tally = campaign(3, 100_000, block=10_000)
    assert tally.damaged >= 100_000
    assert min(tally.by_hit) > 100_000 // len(Hit) // 2
    assert tally.wrong == 0
    assert 0 < tally.lost <= 0.03 * tally.damaged  # 0 would mean that no frame was damaged
    assert tally.streamed > 0
    assert tally.differences == 0
