"""The page about the campaign over changes of the world."""

from __future__ import annotations

from collections import Counter
from statistics import fmean, median
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from campaign.changes import Result

_HEAD = """\
# The world changes during a run

<!-- Written by `python -m campaign.changes` with tests/ on the path. -->

What `recovery` notices, reports and sweeps if something changes while it runs. Every run is the
whole stack in virtual time without supervision, in the rooms that ship; the seed chooses room, time
and size of the change. The [faults](faults.md) are `wheel-slip`, `displaced`, `carried`, `obstacle`
and `person`; a pit is part of the room. Seeds: {first} to {last}. The limits of the checks were set
with other seeds.

| change | runs | complete | stopped | reported | time, median | longest \
| claimed wrongly, mean | worst | coverage, mean | worst | collisions per m² |
"""
_COLUMNS = """
- *stopped*: the run ended with a reason of the list below. *time*: from the change to that end.
- *reported*: the event `start` of source `room`, which says that the walls do not fit the room.
- *claimed wrongly*: floor that the final map shows as swept and that is more than 6 cm from floor
  that really was.
- *coverage*: swept share of what the mouth can reach before and after the change, of completed
  runs.
- A run of *started elsewhere* ends after 400 s at the latest, because only its report matters.

"""


def page(results: Sequence[tuple[str, Result]], first: int) -> str:
    """Return the page."""
    by_name: dict[str, list[Result]] = {}
    for name, result in results:
        by_name.setdefault(name, []).append(result)
    count = max(len(runs) for runs in by_name.values())
    lines = [
        _HEAD.format(first=first, last=first + count - 1),
        f"|{' --- |' * 12}\n",
    ]
    lines += [_row(name, runs) for name, runs in by_name.items()]
    lines.append(_COLUMNS)
    lines.append("## Reasons of stops\n\n")
    for name, runs in by_name.items():
        reasons = Counter(_short(run.reason) for run in runs if run.outcome != "complete")
        if reasons:
            lines.append(f"- {name}: ")
            lines.append("; ".join(f"{n} x {reason}" for reason, n in reasons.most_common()))
            lines.append("\n")
    errors = [r.start_error_m for _, r in results if r.start_error_m is not None]
    if errors:
        lines.append(
            f"\nStarted elsewhere: {len(errors)} runs named the real start, with an error of "
            f"{100 * median(errors):.0f} cm in the median and {100 * max(errors):.0f} cm at most.\n"
        )
    if any(run.fell for _, run in results):
        lines.append(f"\n{sum(run.fell for _, run in results)} runs drove a wheel over a pit.\n")
    held = [run for _, run in results if run.held]
    if held:
        stopped = sum(run.outcome == "stopped" for run in held)
        lines.append(
            f"\nIn {len(held)} runs the moved furniture was put on the robot and held it; "
            f"{stopped} of them were stopped.\n"
        )
    return "".join(lines)


def _row(name: str, runs: Sequence[Result]) -> str:
    complete = [run for run in runs if run.outcome == "complete"]
    stopped = [run for run in runs if run.outcome == "stopped"]
    reported = sum("start" in run.events for run in runs)
    times = [run.ended_s - max(run.at_s, 0.0) for run in stopped if run.at_s < run.ended_s]
    wrong = [run.claimed_wrongly_m2 for run in runs]
    covered = [run.coverage for run in complete]
    cells = (
        name,
        str(len(runs)),
        str(len(complete)),
        str(len(stopped)),
        str(reported),
        f"{median(times):.1f} s" if times else "",
        f"{max(times):.1f} s" if times else "",
        f"{fmean(wrong):.3f} m²",
        f"{max(wrong):.3f} m²",
        f"{100 * fmean(covered):.1f} %" if covered else "",
        f"{100 * min(covered):.1f} %" if covered else "",
        f"{fmean(run.collisions_per_m2 for run in runs):.2f}",
    )
    return f"| {' | '.join(cells)} |\n"


def _short(reason: str) -> str:
    """Return a reason without its numbers."""
    return "".join("N" if c.isdigit() else c for c in reason).replace("NN", "N").replace("NN", "N")
