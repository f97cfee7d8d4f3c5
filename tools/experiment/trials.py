"""What is run: one trial is a room, a planner, a noise level and a seed."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from enum import StrEnum
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.geometry import Pose2
from tools.cli.rooms import load_room
from tools.experiment.layouts import LAYOUT, layout_plan
from tools.experiment.room_generator import KINDS, generate_room

if TYPE_CHECKING:
    from collections.abc import Iterable

GENERATED = "generated:"
"""Rooms named ``generated:KIND:N`` are drawn, not read."""
OPEN_FLOOR = "open-floor"
"""20 m by 20 m with nothing in it, the start in the middle: no wall to correct the estimate."""
HOUR_S = 3600.0
PERFECT = "perfect"
"""As noise ``none``, and the pose that planner and controllers are given is the true one."""
NOISELESS, RANDOM = frozenset({PERFECT, "none"}), "random"
"""Levels at which a run is the same for every seed, but with the planner that draws by it."""
_DRAWN_FROM = 0x5EED
"""Keeps the generated rooms' numbers apart from other uses of small seeds."""


class Kind(StrEnum):
    """How a trial is run and what is measured."""

    RUN = "run"
    """A planner on the whole stack."""
    LIMITS = "limits"
    """The same, and what was not swept is split by cause."""
    CYCLES = "cycles"
    """The paper's U-shaped cycles, no planner."""
    ZIMABLUE = "zimablue"
    """A planner of that package with its own robot in its own simulation."""
    BESIDE = "beside"
    """As a run: another planner in the paper's comprehensive room (its section 5.3)."""
    LAYOUT = "layout"
    """As a run, in a layout in which the paper's algorithm fails; some with another reading of
    the paper."""
    RANGES = "ranges"
    """The paper's algorithm with ranges that are 1 cm wrong."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One run."""

    room: str
    planner: str
    noise: str
    seed: int
    max_time_s: float | None = None
    """Simulated; a run that takes longer is ended. ``None``: an hour, more in large rooms."""
    kind: Kind = Kind.RUN

    @property
    def key(self) -> str:
        """One line that names it."""
        return json.dumps(asdict(self), sort_keys=True)

    @property
    def label(self) -> str:
        """For people."""
        return f"{self.room} {self.planner} {self.noise} seed {self.seed}"


def grid_trials(  # noqa: PLR0913, PLR0917 - the axes of the grid
    rooms: Iterable[str],
    planners: Iterable[str],
    levels: Iterable[str],
    seeds: Iterable[int],
    max_time_s: float | None,
    kind: Kind = Kind.RUN,
) -> list[Trial]:
    """Every room with every planner, level and seed; with one seed where all are alike."""
    seeds = list(seeds)
    return [
        Trial(room, planner, level, seed, max_time_s, kind)
        for room, planner, level, seed in product(rooms, planners, levels, seeds)
        if seed == seeds[0] or planner == RANDOM or level not in NOISELESS
    ]


def generated_rooms(count: int) -> list[str]:
    """Names of ``count`` generated rooms, one kind after the other."""
    return [f"{GENERATED}{KINDS[n % len(KINDS)]}:{n}" for n in range(count)]


def room_of(name: str) -> FloorPlan:
    """Read or draw a room by its name in a trial.

    Raises:
        FloorPlanError: there is no such room, or it cannot be used.

    """
    if name == OPEN_FLOOR:
        corners = ((0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0))
        return FloorPlan(name, corners, (), Pose2(10.0, 10.0, 0.0))
    if name.startswith(LAYOUT):
        return layout_plan(name.removeprefix(LAYOUT))
    kind, _, number = name.removeprefix(GENERATED).partition(":")
    if not name.startswith(GENERATED) or kind not in KINDS or not number.isdecimal():
        return load_room(name)
    return generate_room(int(number), np.random.default_rng([_DRAWN_FROM, int(number)]), kind)


def work(trial: Trial, plan: FloorPlan) -> float:
    """About how long it takes, in no unit: for the time left."""
    x0, y0, x1, y1 = plan.bounds()
    match trial.kind:
        case Kind.CYCLES:
            return 3.0
        case Kind.ZIMABLUE:
            return 6.0 * (x1 - x0) * (y1 - y0)
        case _:
            area_m2 = (x1 - x0) * (y1 - y0)
            if trial.planner == RANDOM:  # as long as it is compared, in every room
                return 1.2 * area_m2
            return math.sqrt(1.0 + area_m2)
