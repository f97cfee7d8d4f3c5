"""Losses in a sequence of frame numbers, as reports and Rerun count them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from bridge.view.run_reading import LossCounter, boot_id_of


class Foreign:
    """A message without a decoder."""

    topic = "/device/hello"

    @property
    def decoded(self) -> object:
        raise ValueError("no decoder for 'json'")


@pytest.mark.parametrize(
    ("message", "boot_id"),
    [
        (SimpleNamespace(topic="/device/hello", decoded=SimpleNamespace(boot_id=7)), 7),
        (SimpleNamespace(topic="/device/hello", decoded=SimpleNamespace()), None),
        (SimpleNamespace(topic="/device/imu", decoded=SimpleNamespace(boot_id=7)), None),
        (Foreign(), None),
    ],
)
def test_only_a_readable_hello_has_a_boot_id(message: Any, boot_id: int | None) -> None:  # noqa: ANN401 - like a message
    assert boot_id_of(message) == boot_id


def lost(sequence: list[int]) -> int:
    counter = LossCounter()
    for number in sequence:
        counter.add(number & 0xFF)
    counter.update()
    return counter.lost


def test_gaps_are_lost_also_across_the_wrap() -> None:
    assert lost([*range(250, 255), *range(258, 270)]) == 3


def test_a_late_number_is_not_lost() -> None:
    assert lost([1, 2, 5, 3, 4, 6]) == 0


def test_a_repeated_number_does_not_replace_a_lost_one() -> None:
    assert lost([1, 2, 4, 4, 5, 5, 8]) == 3


def test_a_boot_is_no_loss() -> None:
    counter = LossCounter()
    counter.add(7, boot_id=1)
    for number in (8, 9, 12):
        counter.add(number)
    counter.add(0, boot_id=2)
    counter.add(1)
    assert counter.update() == 2
    counter.add(2, boot_id=2)
    assert counter.update() == 0


def test_old_gaps_stay_lost() -> None:
    counter = LossCounter()
    for number in (0, 3, *range(4, 260)):
        counter.add(number & 0xFF)
    assert counter.update() == 2
    counter.add(250)  # late
    assert (counter.update(), counter.lost) == (0, 2)
