"""What is run: one trial is a room, a planner, a noise level and a seed."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from bridge.coverage.room_generator import KINDS, generate_room
from tools.rooms import load_room

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from bridge.coverage.floorplan import FloorPlan

GENERATED = "generated:"
"""Rooms named ``generated:KIND:N`` are drawn, not read."""
TABLE_2_SEEDS = 5
"""The paper ran case 1 five times."""
_DRAWN_FROM = 0x5EED
"""Keeps the generated rooms' numbers apart from other uses of small seeds."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One run."""

    room: str
    planner: str
    noise: str
    seed: int

    @property
    def key(self) -> str:
        """One line that names it."""
        return json.dumps(asdict(self), sort_keys=True)

    @property
    def label(self) -> str:
        """For people and file names."""
        return f"{self.room.replace(':', '-')}-{self.planner}-{self.noise}-{self.seed}"


def paper_trials(planners: Sequence[str] = ("paper",)) -> list[Trial]:
    """The paper's own: case 1 five times (Table 2), case 2 (Fig. 17), the comprehensive test."""
    rooms = ("case-1", "case-2", "comprehensive")
    levels = ("paper", "typical")
    return [
        Trial(room, planner, noise, seed)
        for room, planner, noise in product(rooms, planners, levels)
        for seed in range(TABLE_2_SEEDS)
    ]


def grid_trials(
    rooms: Iterable[str], planners: Iterable[str], levels: Iterable[str], seeds: Iterable[int]
) -> list[Trial]:
    """Every room with every planner, level and seed."""
    return [Trial(*parts) for parts in product(rooms, planners, levels, seeds)]


def generated_rooms(count: int) -> list[str]:
    """Names of ``count`` generated rooms, one kind after the other."""
    return [f"{GENERATED}{KINDS[n % len(KINDS)]}:{n}" for n in range(count)]


def room_of(name: str) -> FloorPlan:
    """Read or draw a room by its name in a trial.

    Raises:
        FloorPlanError: there is no such room, or it cannot be used.

    """
    if not name.startswith(GENERATED):
        return load_room(name)
    kind, number = name.removeprefix(GENERATED).split(":")
    return generate_room(int(number), np.random.default_rng([_DRAWN_FROM, int(number)]), kind)
