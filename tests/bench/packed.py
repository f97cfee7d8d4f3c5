"""Cost of a map of two bits a cell: the map is packed and unpacked during the run.

    PYTHONPATH=tests python -m bench.packed

The same planner drives in the same rooms with the same errors, in the simple world of
``support.fast_world`` (the pose is the truth plus a seeded error). The first run uses the normal
map. In the second run the map is reduced to two bits per cell and restored at the end of each leg
(``--every N``: at every Nth). Between two legs no more of the map is kept. During a leg, evidence
is still counted in bytes, which a microcontroller would do only around the robot. The search still
uses full arrays.

The table also shows the value of a third bit. KB are the size of a map of 60 m² without its rim.

- *bumps*: a bit for the places that are blocked after bumps.
- *bumps, 8 cm*: such a bit for each block of four by four cells; it is set if at least half of the
  cells are blocked.
- *tries*: a bit for places with one fruitless attempt.
- *hints*: a bit for cells in which a single reading shows an obstacle.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bridge.coverage.recovery.planner import RecoveryPlanner
from bridge.evaluation.metrics import CoverageMeter
from bridge.motion.legs import Dwell
from bridge.motion.robot_model import RobotModel
from support.fast_world import LEVELS, run_fast
from tools.rooms.generator import generate_room

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from bridge.coverage.planner import Finish
    from bridge.coverage.recovery.map import EvidenceMap
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.legs import Leg, LegResult
    from bridge.motion.observation import Observation

_ROOMS = ("legs:101", "pockets:101", "columns:5", "turned:3", "corridor:7", "flat:2")
_BLOCK = 4
_CELLS = round(60.0 / 0.02**2)


def two_bits(memory: EvidenceMap) -> None:
    """Keep only the packed map."""
    memory.unpack(memory.packed())


def and_bumps(memory: EvidenceMap) -> None:
    blocked = memory.blocked.copy()
    two_bits(memory)
    memory.blocked[:] = blocked


def and_bumps_in_blocks(memory: EvidenceMap) -> None:
    blocked = blocks(memory.blocked)
    two_bits(memory)
    memory.blocked[:] = blocked


def and_tries(memory: EvidenceMap) -> None:
    once = memory.attempts > 0
    two_bits(memory)
    memory.attempts[once & (memory.swept == 0)] = 1


def and_hints(memory: EvidenceMap) -> None:
    hint = memory.wall == 1
    two_bits(memory)
    memory.wall[hint & (memory.visited == 0)] = 1


def blocks(layer: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a layer in blocks of cells: a block is set if at least half of its cells are."""
    rows, columns = layer.shape
    pads = ((0, -rows % _BLOCK), (0, -columns % _BLOCK))
    padded = np.pad(layer, pads)
    high, wide = padded.shape
    share = (padded > 0).reshape(high // _BLOCK, _BLOCK, wide // _BLOCK, _BLOCK).mean(axis=(1, 3))
    whole = np.repeat(np.repeat(share >= 0.5, _BLOCK, axis=0), _BLOCK, axis=1)
    kept: NDArray[np.uint8] = whole[:rows, :columns].astype(np.uint8)
    return kept


@dataclass(frozen=True, slots=True)
class Keeping:
    """The part of a map that is kept at the end of a leg."""

    name: str
    bits: float
    """Number of bits per cell."""
    keep: Callable[[EvidenceMap], None] | None


KEEPINGS = (
    Keeping("all: six bytes", 48.0, None),
    Keeping("two bits", 2.0, two_bits),
    Keeping("and bumps", 3.0, and_bumps),
    Keeping("and bumps, 8 cm", 2.0 + 1.0 / _BLOCK**2, and_bumps_in_blocks),
    Keeping("and tries", 3.0, and_tries),
    Keeping("and hints", 3.0, and_hints),
)


class Forgetful(RecoveryPlanner):
    """Keeps only the given part of its map at the end of every Nth leg."""

    def __init__(self, model: RobotModel, keeping: Keeping, every: int) -> None:
        super().__init__(model)
        self._keep, self._every, self._ended = keeping.keep, every, 0

    def next(self, result: LegResult, obs: Observation) -> Leg | Finish:
        # A search is one decision, so the map is not reduced between two of its slices.
        searching = isinstance(result.leg, Dwell) and result.leg.purpose == "think"
        if self._keep is not None and not searching:
            self._ended += 1
            if self._ended % self._every == 0:
                self._keep(self.context.evidence_map)
        return super().next(result, obs)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of one run."""

    swept: float
    time: float
    length: float
    hole_cm: float
    collisions_per_m2: float
    by_itself: bool


def drive(
    plan: FloorPlan, meter: CoverageMeter, keeping: Keeping, given: argparse.Namespace, seed: int
) -> Outcome:
    """Run a planner that keeps this part of its map."""
    planner = Forgetful(meter.model, keeping, given.every)
    done = run_fast(plan, planner, meter.model, seed=seed, noise=LEVELS[given.noise])
    report = meter.measure(done.poses)
    return Outcome(
        100.0 * report.coverage.mouth_sweepable,
        report.time_ratio,
        report.path_ratio,
        100.0 * report.hole_inradius_m,
        done.collisions / meter.sweepable_m2,
        done.finish_reason is not None and done.finish_reason.startswith("no reachable"),
    )


def line(keeping: Keeping, runs: list[Outcome]) -> str:
    """Return a line of the table: means and worst values of some runs."""
    swept = [run.swept for run in runs]
    times = [run.time for run in runs]
    return (
        f"{keeping.name:16} {keeping.bits * _CELLS / 8e3:7.1f} {np.mean(swept):9.2f} "
        f"{min(swept):6.2f} {np.mean(times):9.2f} {max(times):6.2f} "
        f"{np.mean([run.length for run in runs]):8.2f} {max(run.hole_cm for run in runs):8.1f} "
        f"{np.mean([run.collisions_per_m2 for run in runs]):10.2f} "
        f"{sum(run.by_itself for run in runs):5d}/{len(runs)}"
    )


def main() -> None:
    """Run each room with each seed, and print the results."""
    options = argparse.ArgumentParser(
        description=(__doc__ or "").partition("\n")[0],
        epilog="In the quick toy world, the pose with a drawn error; not the virtual sweeper.",
    )
    options.add_argument("--rooms", default=",".join(_ROOMS), help="KIND:SEED of drawn rooms")
    options.add_argument("--seeds", type=int, default=3, help="of the errors, for each room")
    options.add_argument("--noise", choices=list(LEVELS), default="typical")
    options.add_argument("--every", type=int, default=1, help="leg at whose end it is packed")
    given = options.parse_args()
    model = RobotModel()
    head = (
        f"{'kept of a cell':16} {'KB':>7} {'mouth %':>9} {'worst':>6} {'time':>9} {'worst':>6} "
        f"{'length':>8} {'hole cm':>8} {'coll. / m²':>10} {'ended':>6}"
    )
    everywhere: dict[str, list[Outcome]] = {keeping.name: [] for keeping in KEEPINGS}
    for room in given.rooms.split(","):
        kind, _, number = room.partition(":")
        plan = generate_room(int(number), np.random.default_rng(int(number)), kind)
        meter = CoverageMeter(plan, model, 0.01)
        print(f"\n{room}, {meter.sweepable_m2:.1f} m², noise {given.noise}\n{head}", flush=True)
        for keeping in KEEPINGS:
            runs = [drive(plan, meter, keeping, given, seed) for seed in range(given.seeds)]
            everywhere[keeping.name] += runs
            print(line(keeping, runs), flush=True)
    print(f"\nall rooms\n{head}")
    for keeping in KEEPINGS:
        print(line(keeping, everywhere[keeping.name]))


if __name__ == "__main__":
    main()
