"""Trials of ``experiment paper``: the paper's experiments, and layouts in which ``paper`` fails."""

from __future__ import annotations

from dataclasses import replace

from bridge.coverage.baselines.paper import PaperOptions
from sim_device.noise import NoiseLevel
from tools.experiment.trials import OPEN_FLOOR, Trial, TrialKind
from tools.rooms.layouts import LAYOUT, LAYOUTS

TABLE_2_SEEDS = 5
"""Number of runs of each room: the paper ran case 1 five times (Table 2)."""
CYCLE_SEEDS = 20
"""Number of runs of the cycles of Fig. 15."""
COMPREHENSIVE = "comprehensive"
"""Room of the paper's section 5.3."""
BESIDE = ("u-shape", "random", "recovery")
"""Planners that are compared with the paper's algorithm in the comprehensive room."""

STRICT_END = "paper, strict end"
"""Name of a variant of ``paper``: the first blocked side step ends the run."""
RANGE_LEVEL = NoiseLevel(name="range 1 cm", ultrasonic_sigma_m=0.01)
"""Noise level ``none`` with 1 cm of noise in the ultrasonic range."""

_BY_STEPS = PaperOptions()
_BY_EQUAL = PaperOptions(count_turns="on_equal", between="reset")
TOLERANCES: dict[str, tuple[PaperOptions, str]] = {
    "paper, by steps": (_BY_STEPS, "whole_step"),
    "paper, by steps, 1 cm": (replace(_BY_STEPS, equal_tolerance_m=0.01), "whole_step"),
    "paper, by equals": (_BY_EQUAL, "on_equal, reset between"),
    "paper, by equals, 1 cm": (
        replace(_BY_EQUAL, equal_tolerance_m=0.01),
        "on_equal, reset between",
    ),
}
"""Options and description by name: two ways to count the turns (T in the paper), each with two
tolerances."""

READINGS: dict[str, PaperOptions] = {
    STRICT_END: PaperOptions(end="blocked_step"),
    **{name: options for name, (options, _) in TOLERANCES.items()},
}
"""Options of the variants of ``paper``, by the planner's name in a trial."""


def paper_trials(max_time_s: float | None) -> list[Trial]:
    """Return all trials in the order of the tables."""
    return [
        *_coverage(max_time_s),
        *_beside(max_time_s),
        *_layouts(max_time_s),
        *_ranges(max_time_s),
        *_cycles(max_time_s),
    ]


def _coverage(max_time_s: float | None) -> list[Trial]:
    """Return the trials of case 1 (Table 2), case 2 and the comprehensive room."""
    return [
        Trial(room, "paper", noise, seed, max_time_s)
        for room in ("case-1", "case-2", COMPREHENSIVE)
        for noise in ("paper", "typical")
        for seed in range(TABLE_2_SEEDS)
    ]


def _beside(max_time_s: float | None) -> list[Trial]:
    """Return the trials of section 5.3: the other planners in the comprehensive room."""
    return [
        Trial(COMPREHENSIVE, planner, "paper", seed, max_time_s, TrialKind.BESIDE)
        for planner in BESIDE
        for seed in range(TABLE_2_SEEDS)
    ]


def _layouts(max_time_s: float | None) -> list[Trial]:
    """Return the trials of the layouts, without noise, so that only the algorithm can fail."""
    return [
        Trial(f"{LAYOUT}{name}", planner, "none", 0, max_time_s, TrialKind.LAYOUT)
        for name in LAYOUTS
        for planner in ("paper", STRICT_END, "recovery")
    ]


def _ranges(max_time_s: float | None) -> list[Trial]:
    """Return the trials of case 1 with and without 1 cm of range noise."""
    return [
        Trial("case-1", reading, noise, seed, max_time_s, TrialKind.RANGES)
        for reading in TOLERANCES
        for noise, seeds in (("none", 1), (RANGE_LEVEL.name, TABLE_2_SEEDS))
        for seed in range(seeds)
    ]


def _cycles(max_time_s: float | None) -> list[Trial]:
    """Return the trials of Figs. 12, 14 and 15."""
    return [
        Trial(OPEN_FLOOR, "u-cycles", "paper", seed, max_time_s, TrialKind.CYCLES)
        for seed in range(CYCLE_SEEDS)
    ]
