"""Runs with other values of the tuned constants, and the effect of each value, run by run."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from tools.experiment.paired_differences import Pair, difference
from tools.experiment.settings import constants, scaled
from tools.experiment.tables import Table
from tools.experiment.trials import TrialKind

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from tools.experiment.store import Row
    from tools.experiment.trials import Trial


def sensitivity_trials(
    trials: Sequence[Trial], names: Iterable[str], factors: Iterable[float]
) -> list[Trial]:
    """Return the trials, and each trial again with each constant multiplied by each factor."""
    made = list(trials)
    factors = list(factors)
    for name in names:
        for value in dict.fromkeys(scaled(name, factor) for factor in factors):
            made += [
                dataclasses.replace(
                    trial, kind=TrialKind.SENSITIVITY, options=f"{name}={value:.6g}"
                )
                for trial in trials
            ]
    return made


def sensitivity_table(rows: Sequence[Row]) -> Table:
    """Return the effect of each change of a constant, the largest effect first."""
    known = {_place(row): row for row in rows if row["kind"] == TrialKind.RUN}
    pairs: dict[str, list[Pair]] = {}
    for row in rows:
        before = known.get(_place(row))
        if row["kind"] == TrialKind.SENSITIVITY and before is not None:
            pairs.setdefault(row["options"], []).append((before, row))
    effects: dict[str, float] = {}
    lines: list[tuple[str, ...]] = []
    defaults = constants()
    for options, mine in pairs.items():
        name, _, value = options.partition("=")
        mouth, time = difference(mine, "mouth_sweepable"), difference(mine, "time_ratio")
        # A percentage point of coverage has the same weight as a tenth of the reference time.
        effect = max(100.0 * abs(mouth.mean), 10.0 * abs(time.mean))
        effects[name] = max(effects.get(name, 0.0), effect)
        default = defaults.get(name)
        lines.append(
            (
                name,
                "?" if default is None else f"{default:.4g}",
                f"{float(value):.4g}",
                str(len(mine)),
                mouth.text(100.0),
                f"{100 * min(a['mouth_sweepable'] - b['mouth_sweepable'] for b, a in mine):+.2f}",
                time.text(),
                difference(mine, "collisions").text(),
                str(sum(after["outcome"] != "complete" for _, after in mine)),
            )
        )
    lines.sort(key=lambda line: (-effects[line[0]], line[0], float(line[2])))
    return Table(
        "Sensitivity to the tuned constants",
        (
            *("constant", "default", "value", "pairs", "mouth", "worst", "time ratio"),
            *("collisions per run", "not complete"),
        ),
        lines,
        "Differences from the run with the default in the same room with the same seed, with the "
        "95 % confidence interval of the mean; a star: it does not contain 0. Without any effect, "
        f"about {0.05 * 3 * len(lines):.0f} of the {3 * len(lines)} intervals would have a star. "
        "Mouth in percentage points. The order is by the larger of the mouth's points and ten "
        "times the time ratio.",
    )


def _place(row: Row) -> tuple[object, ...]:
    return tuple(row[name] for name in ("room", "planner", "noise", "seed", "robot"))
