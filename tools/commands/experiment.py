"""``sweepctl experiment``: the paper's experiments and the comparison of planners."""

from __future__ import annotations

import signal
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tools import options

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tools.experiment.store import Row, Store
    from tools.experiment.trials import Trial

_ROOMS = "case-1,case-2,comprehensive,empty,l-room,table-and-chair,columns,two-rooms,studio-flat"
_PLAIN_WIDTH = 200
"""Of tables that go to a file or another program."""


def _listed(allowed: Sequence[str] | None = None) -> Any:  # noqa: ANN401 - click's callback
    def split(ctx: click.Context, param: click.Parameter, text: str) -> list[str]:
        names = [name.strip() for name in text.split(",") if name.strip()]
        for name in names:
            if allowed is not None and name not in allowed:
                raise click.BadParameter(f"{name!r} is not one of {', '.join(allowed)}", ctx, param)
        return list(dict.fromkeys(names))

    return split


@click.command(
    "experiment",
    epilog="Example:  sweepctl experiment compare --rooms case-1,two-rooms --seeds 5 --out cmp",
)
@click.argument("what", type=click.Choice(["paper", "compare"]), default="paper")
@click.option(
    "--rooms",
    callback=_listed(),
    default=_ROOMS,
    help="For compare: names or files, by commas.  [default: all that ship]",
)
@click.option(
    "--generated",
    type=click.IntRange(0, 10_000),
    default=0,
    show_default=True,
    help="For compare: this many generated rooms too.",
)
@click.option(
    "--planners",
    callback=_listed(options.PLANNERS),
    default=",".join(options.PLANNERS),
    show_default=True,
)
@click.option(
    "--noise",
    "levels",
    callback=_listed(options.NOISE_LEVELS),
    default="typical",
    show_default=True,
    help="For compare: levels, by commas.",
)
@click.option("--seeds", type=click.IntRange(1, 10_000), default=3, show_default=True)
@click.option("--jobs", type=click.IntRange(1, 256), help="Processes.  [default: one per core]")
@click.option(
    "--max-time",
    "max_time_s",
    type=options.Seconds(1.0, 1e6),
    default=3600.0,
    show_default=True,
    help="End a run that takes longer, in simulated seconds.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("runs/experiment"),
    show_default=True,
    help="Folder for results; what it holds already is not run again.",
)
@click.option("--force", is_flag=True, help="Begin anew: forget the results in the folder.")
@options.json_option
def command(  # noqa: PLR0913 - one parameter per option
    *,
    what: str,
    rooms: list[str],
    generated: int,
    planners: list[str],
    levels: list[str],
    seeds: int,
    jobs: int | None,
    max_time_s: float,
    out: Path,
    force: bool,
    as_json: bool,
) -> int:
    """Run the PAPER's experiments, or COMPARE planners over rooms, levels and seeds.

    Makes runs.csv, curves.csv and report.html. Ctrl-C keeps what is done: the same command
    goes on from there.
    """
    from tools.experiment import figures
    from tools.experiment.store import Store
    from tools.experiment.trials import generated_rooms, grid_trials, paper_trials, room_of
    from tools.version import VERSION

    figures.check()
    if what == "paper":
        trials = paper_trials()
    else:
        names = [*rooms, *generated_rooms(generated)]
        if not names:
            raise click.UsageError("no rooms: give --rooms or --generated")
        trials = grid_trials(names, planners, levels, range(seeds))
    for name in dict.fromkeys(trial.room for trial in trials):
        room_of(name)  # a wrong name is told now, not after an hour
    if force:
        _forget(out)
    store = Store(out, VERSION)
    ended_early = _run_all(store, trials, max_time_s, jobs)
    rows = store.rows(trials)
    if rows:
        _write(out, what, rows, as_json=as_json)
    if ended_early:
        from tools.console import say

        say(f"{len(rows)} of {len(trials)} runs done; the same command goes on from there")
    return 0


def _forget(out: Path) -> None:
    from tools.experiment.store import LINES

    (out / LINES).unlink(missing_ok=True)


def _run_all(store: Store, trials: list[Trial], max_time_s: float, jobs: int | None) -> bool:
    """Run what is missing; True if Ctrl-C ended it before all was done."""
    import os

    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from tools.console import ERR
    from tools.experiment.worker import run_trial

    missing = store.missing(trials)
    if not missing:
        return False
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with (
        Progress(*columns, console=ERR, disable=not ERR.is_terminal) as bar,
        ProcessPoolExecutor(jobs or os.cpu_count(), initializer=_leave_ctrl_c_to_parent) as pool,
    ):
        task = bar.add_task("runs", total=len(trials), completed=len(trials) - len(missing))
        running: dict[Future[dict[str, Any]], Trial] = {
            pool.submit(run_trial, trial, max_time_s): trial for trial in missing
        }
        try:
            while running:
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    trial = running.pop(future)
                    store.add(trial, future.result())
                    bar.update(task, advance=1, description=trial.label)
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            return True
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return False


def _leave_ctrl_c_to_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _write(out: Path, what: str, rows: list[Row], *, as_json: bool) -> None:
    import json
    import sys

    from rich.console import Console
    from rich.table import Table as RichTable

    from tools.experiment import report
    from tools.experiment.store import write_csv
    from tools.experiment.worker import MULTIPLES

    write_csv(out / "runs.csv", rows)
    curves = [
        {
            **{key: row[key] for key in ("room", "planner", "noise", "seed")},
            "lower_bounds": multiple,
            "mouth_sweepable": row["curve"]["coverage"][k],
            "energy_wh": row["curve"]["energy_wh"][k],
        }
        for row in rows
        for k, multiple in enumerate(MULTIPLES)
    ]
    write_csv(out / "curves.csv", curves)
    title = "The paper's experiments" if what == "paper" else "Planners compared"
    page = report.render(title, f"sweepctl experiment {what}", rows, ())
    (out / "report.html").write_text(page, encoding="utf-8")
    tables = report.all_tables(rows)
    if as_json:
        summary = {
            "runs": len(rows),
            "report": str(out / "report.html"),
            "tables": {
                t.title: [dict(zip(t.head, line, strict=True)) for line in t.rows] for t in tables
            },
        }
        sys.stdout.write(json.dumps(summary) + "\n")
        return
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = _PLAIN_WIDTH
    for table in tables:
        shown = RichTable(title=table.title, title_justify="left", box=None)
        for name in table.head:
            shown.add_column(name)
        for line in table.rows:
            shown.add_row(*line)
        console.print(shown)
        console.print()
    console.print(f"report: {out / 'report.html'}")
