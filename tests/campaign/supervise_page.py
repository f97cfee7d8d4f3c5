"""The page about the campaign over supervision."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from bridge.supervise import SuperviseSettings
from campaign.hazards import GRACE_S

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from campaign.outcome import Outcome

MOST_PER_HOUR = 1.0
_HEAD = """\
# Supervision held against the truth

<!-- Written by `python -m campaign.supervise` with tests/ on the path. -->

Every run is the whole stack in virtual time at noise `typical`: the device's planner, or the
host's, in the rooms that ship; the rules at their defaults, every reaction lowered to *tell* so
that a run goes on after an alarm. Seeds are other ones than the rules were made with.

"""
_TRUTH = """
*Borne out*: nothing was injected, and yet it is so. The device's planner told a D that is more than
3 cm off the way that its body truly made, as the simulation knows it: an estimate that a wall, seen
wrongly, has corrected within the lane. To find that is what the rule is for.
"""
_HAZARDS = """
## Hazards

*Ended*: before a rule of the host spoke, the device had stopped by itself (cause `hardware`), or
the session had found that it was lost and is back, booted anew, and had ended the run. Time is
from the hazard's beginning to the first alarm of a rule that is meant for it; where a hazard can
only show later (a lane must end, a wall must be ahead), it is long. *Recall* is of all runs.

"""
_RULES = """
## Rules

Over all runs. *Right*: of a rule that the hazard is meant for, while it lasted or within
{grace:g} s of it, or borne out by the truth. *With it*: of another rule meanwhile, as where a wheel
that sticks slips. *False*: all others. *Precision*: those that are not false, of all.

"""


def page(outcomes: Sequence[Outcome]) -> tuple[str, bool]:
    """The tables, and whether what is demanded holds."""
    clean = [o for o in outcomes if o.job.hazard is None]
    hours = sum(o.watched_s for o in clean) / 3600.0
    false = Counter(a.rule for o in clean for a in o.alarms if not a.true)
    true = Counter(a.rule for o in clean for a in o.alarms if a.true)
    per_hour = false.total() / hours if hours else 0.0
    told = (
        f"{len(clean)} runs, {hours:.1f} simulated hours of driving: **{false.total()} false "
        f"alarms, {per_hour:.2f} per hour** (at most {MOST_PER_HOUR:g} is allowed), and "
        f"{true.total()} that are borne out by the truth.\n"
    )
    parts = [_HEAD, "## Without any hazard\n\n", told]
    if false or true:
        rows = [
            (rule, false[rule], true[rule], f"{false[rule] / hours:.2f}")
            for rule in sorted(false | true)
        ]
        parts += ["\n", _table("rule", "false", "borne out", "false per hour", rows=rows)]
    parts.append(_TRUTH)
    table, missed = _hazards(outcomes)
    parts += [_HAZARDS, table, _RULES.format(grace=GRACE_S), _rules(outcomes)]
    return "".join(parts), missed == 0 and per_hour <= MOST_PER_HOUR


def _hazards(outcomes: Iterable[Outcome]) -> tuple[str, int]:
    by_name: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        if outcome.job.hazard is not None:
            by_name.setdefault(outcome.job.hazard.name, []).append(outcome)
    rows: list[tuple[object, ...]] = []
    all_runs = all_missed = 0
    for name, runs in by_name.items():
        times = sorted(t for o in runs if (t := o.caught_s) is not None)
        ended = sum(o.caught_s is None and o.ended_it for o in runs)
        missed = len(runs) - len(times) - ended
        all_runs, all_missed = all_runs + len(runs), all_missed + missed
        hazard = runs[0].job.hazard
        rules = ", ".join(sorted(hazard.rules)) if hazard else ""
        middle = f"{times[len(times) // 2]:.1f} s" if times else ""
        longest = f"{times[-1]:.1f} s" if times else ""
        recall = f"{1.0 - missed / len(runs):.2f}"
        rows.append((name, rules, len(runs), len(times), ended, missed, recall, middle, longest))
    heads = ("hazard", "meant for", "runs", "caught", "ended", "missed", "recall")
    text = _table(*heads, "time, median", "longest", rows=rows)
    return f"{text}\n{all_runs} hazards, {all_missed} missed.\n", all_missed


def _rules(outcomes: Iterable[Outcome]) -> str:
    right, beside, false = Counter[str](), Counter[str](), Counter[str]()
    for outcome in outcomes:
        hazard = outcome.job.hazard
        for alarm in outcome.alarms:
            within = hazard is not None and (
                outcome.at_s <= alarm.at_s <= hazard.ends_s(outcome.at_s) + GRACE_S
            )
            meant = hazard is not None and alarm.rule in hazard.rules
            kind = right if alarm.true or (within and meant) else beside if within else false
            kind[alarm.rule] += 1
    rows: list[tuple[object, ...]] = []
    for rule in SuperviseSettings().rules:
        count = right[rule] + beside[rule] + false[rule]
        precision = f"{1.0 - false[rule] / count:.3f}" if count else ""
        rows.append((rule, count, right[rule], beside[rule], false[rule], precision))
    sums = right.total(), beside.total(), false.total()
    precision = f"{1.0 - sums[2] / sum(sums):.3f}" if sum(sums) else ""
    rows.append(("*together*", sum(sums), *sums, precision))
    return _table("rule", "alarms", "right", "with it", "false", "precision", rows=rows)


def _table(*heads: str, rows: Iterable[tuple[object, ...]]) -> str:
    lines = [heads, ("---",) * len(heads), *rows]
    return "".join(f"| {' | '.join(map(str, line))} |\n" for line in lines)
