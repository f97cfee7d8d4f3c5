"""``sweepctl experiment``: the paper's experiments, comparisons, and the limits of coverage."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tools.cli import options
from tools.cli.completion import complete_robots, complete_rooms
from tools.cli.configuration import NOISE_LEVELS, given
from tools.cli.console import inform, print_error
from tools.cli.paths import PathName
from tools.cli.planners import PLANNERS, PlannerList

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tools.experiment.runs import TrialsOutcome
    from tools.experiment.trials import Trial

_ROOMS = "case-1,case-2,comprehensive,empty,l-room,table-and-chair,columns,two-rooms,studio-flat"
_DEFAULT = "recovery"
_PLANNERS = tuple(dict.fromkeys((_DEFAULT, *PLANNERS)))
_GRID = ("rooms", "generated", "planners", "levels", "seeds", "robots")
"""Parameters of all subcommands except ``paper``, whose experiments have fixed parameters."""
_TITLES = {
    "paper": "The paper's experiments",
    "compare": "Planners compared",
    "limits": "What limits coverage",
    "sensitivity": "Sensitivity to the tuned constants",
}


def _listed(allowed: Sequence[str] | None = None) -> Any:  # noqa: ANN401 - click's callback
    def split(ctx: click.Context, param: click.Parameter, text: str | None) -> list[str] | None:
        if text is None:
            return None
        names = [name.strip() for name in text.split(",") if name.strip()]
        for name in names:
            if allowed is not None and name not in allowed:
                raise click.BadParameter(f"{name!r} is not one of {', '.join(allowed)}", ctx, param)
        return list(dict.fromkeys(names))

    return split


def _factors(ctx: click.Context, param: click.Parameter, text: str) -> list[float]:
    try:
        factors = [float(part) for part in text.split(",")]
    except ValueError:
        factors = []
    if not factors or not all(0.0 < factor < 100.0 for factor in factors):  # noqa: PLR2004 - far
        raise click.BadParameter(f"{text!r} is not a list of factors above 0", ctx, param)
    return factors


@click.command(
    "experiment",
    epilog="Example:  sweepctl experiment compare --rooms case-1,two-rooms --seeds 5 --out cmp",
)
@click.argument("what", type=click.Choice(list(_TITLES)), default="paper")
@click.option(
    "--rooms",
    callback=_listed(),
    shell_complete=complete_rooms,
    default=_ROOMS,
    help="Names or files of rooms, separated by commas.  [default: all shipped rooms]",
)
@click.option(
    "--generated",
    type=click.IntRange(0, 10_000),
    default=0,
    show_default=True,
    metavar="N",
    help="Add N generated rooms; with --rooms '' there are no others.",
)
@click.option(
    "--planners",
    type=PlannerList(),
    help="Planners, separated by commas.  [default: those of sweepctl; for limits: recovery]",
)
@click.option(
    "--noise",
    "levels",
    callback=_listed(NOISE_LEVELS),
    default="typical",
    show_default=True,
    help="Noise levels of none, paper, typical, harsh, separated by commas; limits also runs the "
    "level perfect.",
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 10_000),
    default=3,
    show_default=True,
    metavar="N",
    help="Runs of each combination, with seeds 0 to N-1; without noise one run, because all are "
    "equal.",
)
@click.option(
    "--robots",
    callback=_listed(),
    shell_complete=complete_robots,
    help="Robot files, separated by commas: every combination is run with each of them.  "
    "[default: the paper's robot]",
)
@click.option(
    "--against",
    type=PathName(exists=True, file_okay=False),
    metavar="FOLDER",
    help="Compare run by run with the results of compare in FOLDER, made by another version of the "
    "code.",
)
@click.option(
    "--constants",
    callback=_listed(),
    help="For sensitivity: names of tuned constants, or of their groups, separated by commas, "
    "such as planner.back_off_m.  [default: all]",
)
@click.option(
    "--factors",
    callback=_factors,
    default="0.7,1.4",
    show_default=True,
    help="For sensitivity: factors of each constant.",
)
@click.option("--zimablue", is_flag=True, help="Add the online planners of the package zimablue.")
@click.option(
    "--jobs",
    type=click.IntRange(1, 256),
    metavar="N",
    help="Number of parallel processes.  [default: one per core]",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Run on the Dask cluster of this scheduler (tcp://HOST:8786) instead of local processes.",
)
@click.option(
    "--max-time",
    "max_time_s",
    type=options.Number(1.0, 1e6),
    metavar="N",
    help="Time limit of a run in simulated seconds.  [default: 3600, or 15 times the room's "
    "reference time if that is more; less for random and the planners of zimablue]",
)
@click.option(
    "--out",
    type=PathName(file_okay=False),
    default=Path("runs/experiment"),
    show_default=True,
    help="Folder for results; runs that it already contains are not repeated.",
)
@click.option("--force", is_flag=True, help="Discard the results in the folder.")
@options.json_option
@click.pass_context
def command(  # noqa: PLR0913 - one parameter per option
    ctx: click.Context,
    *,
    what: str,
    rooms: list[str],
    generated: int,
    planners: list[str] | None,
    levels: list[str],
    seeds: int,
    robots: list[str] | None,
    against: Path | None,
    constants: list[str] | None,
    factors: list[float],
    zimablue: bool,
    jobs: int | None,
    scheduler: str | None,
    max_time_s: float | None,
    out: Path,
    force: bool,
    as_json: bool,
) -> int:
    """Reproduce the paper's experiments, compare planners, or find what limits their coverage.

    paper reproduces Table 2 (cases 1 and 2), section 5.3 (the comprehensive room with the planners
    u-shape and random), Figs. 14 and 15 (path keeping) and Fig. 12 (velocity smoothing). It also
    runs the layouts in which the paper's algorithm fails. It has its own rooms, planners, noise
    levels and seeds.

    compare runs every combination of room, planner, noise level and seed. limits adds runs with a
    perfect pose and perfect ranges, and splits the lost coverage by cause.

    With --against, compare also pairs each run with the same run in a folder of results of another
    version of the code: first run compare with the one version, then with the other.

    sensitivity runs recovery with each tuned constant multiplied by each of --factors, and compares
    with the defaults run by run.

    --rooms also takes generated:KIND:N and layout:NAME (`docs/rooms.md`). With --robots, a table
    compares the robots.

    The results are runs.csv, curves.csv, tables.md, report.html, and the Parquet dataset in the
    folder dataset. Ctrl-C or SIGTERM ends the runs and reports on those that are done; the same
    command continues from there.
    """
    from tools.cli.signals import leaving_at_once
    from tools.experiment import figures, output
    from tools.experiment.paper_trials import paper_trials
    from tools.experiment.runs import run_all
    from tools.experiment.sensitivity import sensitivity_trials
    from tools.experiment.store import Store, check_compiled, code_version
    from tools.experiment.trials import generated_rooms, with_robots
    from tools.experiment.version_comparison import read_rows

    figures.check()
    _check_use(ctx, what, planners, zimablue=zimablue, robots=robots)
    if what == "paper":
        _reject_grid(ctx)
        trials = paper_trials(max_time_s)
    else:
        names = [*rooms, *generated_rooms(generated)]
        if not names:
            raise click.UsageError("no room: give --rooms or --generated")
        trials = _trials(what, names, planners, levels, range(seeds), max_time_s, zimablue=zimablue)
        trials = with_robots(trials, robots) if robots else trials
        if what == "sensitivity":
            trials = sensitivity_trials(trials, _constants(constants), factors)
    for trial in {(trial.room, trial.robot): trial for trial in trials}.values():
        _ = trial.plan  # so that a wrong name is reported now, not after an hour
    _check_planners(trials)
    before = None if against is None else read_rows(against)
    check_compiled()
    store = Store(out, code_version([trial.planner for trial in trials]), force=force)
    with leaving_at_once(
        f"interrupted before the report; completed runs are kept in {out}\n"
        "the same command continues from there"
    ):
        outcome = run_all(store, trials, jobs, scheduler)
        rows = store.rows(trials)
        if outcome.interrupted and rows:
            inform("interrupted: writing the report on the completed runs")
        if rows or as_json:
            made = output.write_results(out, _TITLES[what], _typed(what), rows, before)
            if as_json:
                output.print_json(made, out, rows, outcome.failed)
            else:
                output.print_tables(made, out)
    return _close(outcome, f"{len(rows)} of {len(trials)} runs done", out)


def _check_use(
    ctx: click.Context,
    what: str,
    planners: list[str] | None,
    *,
    zimablue: bool,
    robots: list[str] | None,
) -> None:
    """Reject options that belong to another experiment.

    Raises:
        click.UsageError: an option of another experiment was given.

    """
    for name in ("against", "zimablue"):
        if ctx.params[name] and what != "compare":
            raise click.UsageError(f"--{name} needs compare")
    for name in ("constants", "factors"):
        if given(name) and what != "sensitivity":
            raise click.UsageError(f"--{name} needs sensitivity")
    if ctx.params["scheduler"] is not None and ctx.params["jobs"] is not None:
        raise click.UsageError("--jobs is for local processes: leave it out with --scheduler")
    if zimablue and robots:
        raise click.UsageError("--zimablue has a robot of its own: leave out --robots")
    if what == "sensitivity" and planners is not None and list(planners) != [_DEFAULT]:
        raise click.UsageError(f"sensitivity runs {_DEFAULT}: leave out --planners")


def _constants(names: list[str] | None) -> list[str]:
    """Return the constants of these names and groups.

    Raises:
        click.BadParameter: no constant or group has one of the names.

    """
    from bridge.spelling import unknown_key
    from tools.experiment.settings import constants

    known = list(constants())
    found: list[str] = []
    for name in names or known:
        mine = [each for each in known if each == name or each.startswith(f"{name}.")]
        if not mine:
            group = name.partition(".")[0]
            groups = {each.partition(".")[0] for each in known}
            near = [each for each in known if each.startswith(f"{group}.")] or groups
            raise click.BadParameter(unknown_key("", name, near), param_hint="--constants")
        found += mine
    return list(dict.fromkeys(found))


def _check_planners(trials: Sequence[Trial]) -> None:
    """Make each planner of a plug-in or file once, so that an error is reported before the runs.

    Raises:
        click.BadParameter: a planner cannot be made.

    """
    import random

    from tools.cli.planners import make, planner_names

    outside = {trial.planner: trial for trial in trials if trial.planner not in PLANNERS}
    for name, trial in outside.items():
        if name in planner_names() or ":" in name:  # not a planner of zimablue
            make(name, trial.model, random.Random(0), option="--planners")


def _reject_grid(ctx: click.Context) -> None:
    """Reject the options that the paper's experiments would ignore.

    Raises:
        click.UsageError: such an option was given.

    """
    wrong = [p.opts[0] for p in ctx.command.params if p.name in _GRID and given(p.name)]
    if wrong:
        raise click.UsageError(
            f"{', '.join(wrong)}: not for paper, which has its own rooms, planners, "
            "noise levels and seeds"
        )


def _close(outcome: TrialsOutcome, done: str, out: Path) -> int:
    """Print the failures and return the exit status."""
    from tools.experiment.runs import ERRORS

    if outcome.interrupted:
        inform(f"{done}, kept in {out}; the same command continues from there")
    for line in outcome.failed:
        print_error(line)
    if outcome.failed:
        inform(f"tracebacks: {out / ERRORS}")
    return 1 if outcome.failed else 0


def _trials(  # noqa: PLR0913, PLR0917 - one parameter for each axis of the grid
    what: str,
    names: list[str],
    planners: list[str] | None,
    levels: list[str],
    seeds: range,
    max_time_s: float | None,
    *,
    zimablue: bool,
) -> list[Trial]:
    from tools.experiment.trials import PERFECT, TrialKind, grid_trials
    from tools.experiment.zimablue_run import check, zimablue_trials

    if what == "sensitivity":
        return grid_trials(names, [_DEFAULT], levels, seeds, max_time_s)
    if what == "limits":
        mine = planners or [_DEFAULT]
        beside = dict.fromkeys([PERFECT, *levels])
        return grid_trials(names, mine, beside, seeds, max_time_s, TrialKind.LIMITS)
    trials = grid_trials(names, planners or _PLANNERS, levels, seeds, max_time_s)
    if zimablue:
        check()
        trials += zimablue_trials(names, seeds, max_time_s)
    return trials


def _typed(what: str) -> str:
    """Return the command line; if called from another program, the command's name."""
    import shlex

    arguments = sys.argv[1:]
    if "experiment" not in arguments:
        return f"sweepctl experiment {what}"
    return shlex.join(["sweepctl", *arguments])
