"""Trials: combinations of a room, a planner, a noise level and a seed."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.config import load_robot
from bridge.floor_plan.floor_plan import FloorPlan, FloorPlanError
from bridge.motion.geometry import Pose2
from tools.cli.planners import PLANNERS
from tools.cli.rooms import GENERATED, load_room, shipped_rooms
from tools.rooms.generator import KINDS
from tools.rooms.layouts import LAYOUT

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from bridge.motion.robot_model import RobotModel


OPEN_FLOOR = "open-floor"
"""Name of an empty room of 20 m by 20 m with the start in the middle, where the robot measures no
wall."""
HOUR_S = 3600.0
"""Default time limit of a run, s."""
PERFECT = "perfect"
"""Name of the noise level ``none`` with the true pose for planner and controllers."""
NOISELESS = frozenset({PERFECT, "none"})
"""Noise levels at which every seed gives an equal run with a planner of ``SEEDLESS``."""
RANDOM = "random"
"""Name of the planner that uses the seed itself."""
SEEDLESS = frozenset(PLANNERS) - {RANDOM}
"""Planners that do not use the seed."""


class TrialKind(StrEnum):
    """Kind of a trial: how it is run and what is measured."""

    RUN = "run"
    """A planner with the whole stack."""
    LIMITS = "limits"
    """A run whose lost coverage is split by cause."""
    CYCLES = "cycles"
    """The paper's U-shaped cycles, without a planner."""
    ZIMABLUE = "zimablue"
    """A planner of the package zimablue with its own robot in its own simulation."""
    BESIDE = "beside"
    """A run of another planner in the paper's comprehensive room (section 5.3)."""
    LAYOUT = "layout"
    """A run in a layout in which the paper's algorithm fails; some with a variant of ``paper``."""
    SENSITIVITY = "sensitivity"
    """A run with another value of a tuned constant."""
    RANGES = "ranges"
    """A run of the paper's algorithm with 1 cm of range noise."""


ROOMS_HERE: dict[str, FloorPlan] = {}
"""Rooms that another machine has sent, by the names of its files."""
ROBOTS_HERE: dict[str, RobotModel] = {}
"""Robots that another machine has sent, by the names of its files."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One run of an experiment."""

    room: str
    planner: str
    noise: str
    seed: int
    max_time_s: float | None = None
    """Time limit in simulated seconds; None: an hour, more in large rooms."""
    kind: TrialKind = TrialKind.RUN
    robot: str = ""
    """Robot file; empty: the default robot."""
    robot_hash: str = ""
    """Hash of the robot file's content, so that results with other content are not reused."""
    room_hash: str = ""
    """Hash of the room, if it is a file."""
    options: str = ""
    """Changed tuned constants as ``NAME=VALUE``, separated by commas; empty: none is changed."""

    @property
    def key(self) -> str:
        """Text that identifies the trial in the store."""
        return json.dumps(asdict(self), sort_keys=True)

    @property
    def label(self) -> str:
        """Short text for messages."""
        what = f"{self.room} {self.planner} {self.noise} seed {self.seed}"
        what = f"{what} {self.options}" if self.options else what
        return f"{what} robot {robot_label(self.robot)}" if self.robot else what

    @property
    def model(self) -> RobotModel:
        """The robot.

        Raises:
            ConfigError: the robot file cannot be read or is invalid.

        """
        sent = ROBOTS_HERE.get(self.robot)
        return sent or load_robot(Path(self.robot) if self.robot else None)[0]

    @property
    def plan(self) -> FloorPlan:
        """The room, with a start at which the robot fits if the room is generated.

        Raises:
            FloorPlanError: there is no such room, its file is invalid, or the robot of a robot file
                does not fit at its start.

        """
        try:
            return room_of(self.room, self.model.radius_m if self.robot else 0.0)
        except FloorPlanError as error:
            if not self.robot:
                raise
            raise FloorPlanError(f"{self.label}: {error}") from None


def robot_label(robot: str) -> str:
    """Return the short name of a robot file; ``default`` without one."""
    return Path(robot).stem if robot else "default"


def with_robots(trials: Sequence[Trial], robots: Iterable[str]) -> list[Trial]:
    """Return the trials once for each robot file.

    Raises:
        ConfigError: a file cannot be read or is invalid.

    """
    made: list[Trial] = []
    for robot in robots:
        _, text = load_robot(Path(robot))
        digest = _digest(text)
        made += [replace(trial, robot=robot, robot_hash=digest) for trial in trials]
    return made


def grid_trials(  # noqa: PLR0913, PLR0917 - one parameter for each axis of the grid
    rooms: Iterable[str],
    planners: Iterable[str],
    levels: Iterable[str],
    seeds: Iterable[int],
    max_time_s: float | None,
    kind: TrialKind = TrialKind.RUN,
) -> list[Trial]:
    """Return every combination of room, planner, level and seed.

    If every seed gives an equal run, only one seed is used. A planner of another package may use
    the seed.

    Raises:
        FloorPlanError: the file of a room cannot be read or is invalid.

    """
    seeds, rooms = list(seeds), list(rooms)
    hashes = {room: _digest(load_room(room).to_json()) if is_file(room) else "" for room in rooms}
    return [
        Trial(room, planner, level, seed, max_time_s, kind, room_hash=hashes[room])
        for room, planner, level, seed in product(rooms, planners, levels, seeds)
        if seed == seeds[0] or planner not in SEEDLESS or level not in NOISELESS
    ]


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def generated_rooms(count: int) -> list[str]:
    """Return the names of ``count`` generated rooms, cycling through the kinds."""
    return [f"{GENERATED}{KINDS[n % len(KINDS)]}:{n}" for n in range(count)]


def room_of(name: str, radius_m: float = 0.0) -> FloorPlan:
    """Read or generate a room by its name in a trial.

    In a generated room, a footprint with the radius ``radius_m`` (m) fits at the start.

    Raises:
        FloorPlanError: there is no such room, or its file is invalid.

    """
    if name == OPEN_FLOOR:
        corners = ((0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0))
        return FloorPlan(name, corners, (), Pose2(10.0, 10.0, 0.0))
    return ROOMS_HERE.get(name) or load_room(name, radius_m or None)


def is_made(room: str) -> bool:
    """Return whether a room is generated or a layout."""
    return room.startswith((LAYOUT, GENERATED))


def is_file(room: str) -> bool:
    """Return whether a room is a file, which another machine does not have."""
    return room != OPEN_FLOOR and not is_made(room) and room not in shipped_rooms()


def work(trial: Trial, plan: FloorPlan) -> float:
    """Return the approximate cost of a trial in arbitrary units, to estimate the time left."""
    x0, y0, x1, y1 = plan.bounds()
    match trial.kind:
        case TrialKind.CYCLES:
            return 3.0
        case TrialKind.ZIMABLUE:
            return 6.0 * (x1 - x0) * (y1 - y0)
        case _:
            area_m2 = (x1 - x0) * (y1 - y0)
            if trial.planner == RANDOM:  # its run lasts to the last multiple in every room
                return 1.2 * area_m2
            return math.sqrt(1.0 + area_m2)
