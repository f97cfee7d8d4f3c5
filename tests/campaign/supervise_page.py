"""The page about the supervision campaign."""

from __future__ import annotations

from collections import Counter
from statistics import median
from typing import TYPE_CHECKING

from bridge.supervise import SuperviseSettings
from campaign.hazards import GRACE_S

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from campaign.outcome import Outcome

MAX_PER_HOUR = 1.0
_HEAD = """\
# Supervision compared with the truth

<!-- Written by `python -m campaign.supervise` with tests/ on the path. -->

This page measures how many hazards the [rules of supervision](supervise.md) catch, and how many
false alarms they raise.

Every run is the whole stack in virtual time at noise `typical`, in the rooms that ship, with a
planner on the device or on the host. The rules have their defaults, but every reaction is lowered
to *report*, so that a run continues after an alarm. The seeds differ from those with which the
rules were tuned.

"""
_TRUTH = """
*True* alarms report a real error although no hazard was injected. The device's planner reported a
lane length D that differs by more than 3 cm from the true distance. During the lane, a wrong wall
measurement shifted the device's estimate. The rule exists to find this.
"""
_HAZARDS = """
## Hazards

- *Caught*: a rule that is meant for the hazard raised an alarm.
- *Ended*: the run ended before that. The device stopped by itself (cause `hardware`), a
  [check of the run](run-checks.md) stopped it, or the session found that the device had rebooted.
- *Recall*: share of the runs that were caught or ended.
- *Time*: from the beginning of the hazard to the first alarm of a rule that is meant for it. It is
  long for a hazard that shows only at the end of a lane or before a wall.
- In hazards whose name begins with *reports*, and in *T jumps by two*, the device's planner reports
  a false value. D, Prev-D, Length and T are those of the
  [planner check](supervise.md#the-planner-check).

"""
_RULES = """
## Rules

Alarms of all runs:

- *Right*: the rule is meant for the hazard, and the hazard is present or ended at most {grace:g} s
  before the alarm. *True* alarms (above) also count as right.
- *Consequence*: the alarm of another rule during the same hazard. For example, a stuck wheel also
  slips.
- *False*: all other alarms.
- *Precision*: share of the alarms that are not false.

"""


def page(outcomes: Sequence[Outcome]) -> tuple[str, bool]:
    """Return the tables, and whether the requirements are met."""
    clean = [o for o in outcomes if o.job.hazard is None]
    hours = sum(o.supervised_s for o in clean) / 3600.0
    false = Counter(a.rule for o in clean for a in o.alarms if not a.true)
    true = Counter(a.rule for o in clean for a in o.alarms if a.true)
    stopped = sum(o.by_check for o in clean)
    if stopped:
        false["check of the run"] = stopped
    per_hour = false.total() / hours if hours else 0.0
    reported = (
        f"{len(clean)} runs, {hours:.1f} simulated hours of driving: **{false.total()} false "
        f"alarms, {per_hour:.2f} per hour** (limit: {MAX_PER_HOUR:g} per hour), and "
        f"{true.total()} true alarms.\n"
    )
    parts = [_HEAD, "## Without a hazard\n\n", reported]
    if false or true:
        rows = [
            (rule, false[rule], true[rule], f"{false[rule] / hours:.2f}")
            for rule in sorted(false | true)
        ]
        parts += ["\n", _table("rule", "false", "true", "false per hour", rows=rows)]
    parts.append(_TRUTH)
    table, missed = _hazards(outcomes)
    parts += [_HAZARDS, table, _RULES.format(grace=GRACE_S), _rules(outcomes)]
    return "".join(parts), missed == 0 and per_hour <= MAX_PER_HOUR


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
        middle = f"{median(times):.1f} s" if times else ""
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
    return _table("rule", "alarms", "right", "consequence", "false", "precision", rows=rows)


def _table(*heads: str, rows: Iterable[tuple[object, ...]]) -> str:
    lines = [heads, ("---",) * len(heads), *rows]
    return "".join(f"| {' | '.join(map(str, line))} |\n" for line in lines)
