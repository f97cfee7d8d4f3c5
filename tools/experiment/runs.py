"""Runs trials in parallel, with progress, Ctrl-C and errors by trial."""

from __future__ import annotations

import os
import traceback
from concurrent.futures import CancelledError
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn, TimeElapsedColumn
from rich.text import Text

from tools.cli.console import err, inform, is_drawable
from tools.cli.pools import ClusterPool, LocalPool, NotBegunError, results
from tools.cli.signals import until_signalled
from tools.experiment.ending import prepare_worker
from tools.experiment.shipping import WorkerVersionError, run_shipped, shipped
from tools.experiment.trials import work

if TYPE_CHECKING:
    from concurrent.futures import Future

    from rich.progress import Task, TaskID

    from tools.cli.pools import Pool
    from tools.experiment.store import Store
    from tools.experiment.trials import Trial

_SPEED_OVER_S = 1800.0
"""Period over which the speed for the remaining time is averaged, s."""
ERRORS = "errors.txt"
"""File in the experiment's folder with the tracebacks of failed trials."""


@dataclass(slots=True)
class TrialsOutcome:
    """Result of a batch of trials."""

    interrupted: bool = False
    """The runs were ended before all trials were done."""
    failed: list[str] = field(default_factory=list)
    """A line for each failed trial with its error."""


class _Left(ProgressColumn):
    """Progress column with the remaining time."""

    def render(self, task: Task) -> Text:
        """Return the remaining time."""
        return Text(_time_left(task), style="progress.remaining")


def run_all(
    store: Store, trials: list[Trial], jobs: int | None, scheduler: str | None = None
) -> TrialsOutcome:
    """Run the trials that the store lacks. A failed trial is reported, and the others continue.

    Ctrl-C or SIGTERM ends the runs. The signal is polled and raises no exception. An exception
    during the start or the end of the pool would leave processes that wait for each other forever.

    Args:
        store: stores the results.
        trials: what to run.
        jobs: number of processes; None: one per core.
        scheduler: address of the scheduler of a Dask cluster; None: processes of this machine.

    Raises:
        ClusterMissingError: distributed or pyarrow is not installed.
        ClusterError: the scheduler cannot be reached.
        SchedulerAddressError: the text is not an address.

    """
    missing = store.missing(trials)
    outcome = TrialsOutcome()
    if not missing:
        return outcome

    def end() -> None:
        outcome.interrupted = True

    with until_signalled(end), _pool(len(missing), jobs, scheduler) as pool:
        with Progress(
            TextColumn("{task.fields[done]}/{task.fields[count]}"),
            BarColumn(),
            TimeElapsedColumn(),
            _Left(),
            TextColumn("{task.description}"),
            console=err(),
            disable=not is_drawable(),
            speed_estimate_period=_SPEED_OVER_S,
        ) as bar:
            for note in pool.notes:
                inform(note)
            if not is_drawable() or scheduler is not None:
                inform(f"{len(trials) - len(missing)}/{len(trials)} runs done, {pool.where}")
            try:
                _collect(store, missing, len(trials), pool, bar, outcome)
            except (BrokenProcessPool, CancelledError, WorkerVersionError) as error:
                _break_off(outcome, error)
        if outcome.interrupted:
            pool.abandon()
    store.seal()
    return outcome


def _pool(missing: int, jobs: int | None, scheduler: str | None) -> Pool:
    if scheduler is not None:
        return ClusterPool(scheduler)
    return LocalPool(min(jobs or os.cpu_count() or 1, missing), prepare_worker)


def _collect(  # noqa: PLR0913, PLR0917 - the parts of the loop
    store: Store,
    missing: list[Trial],
    count: int,
    pool: Pool,
    bar: Progress,
    outcome: TrialsOutcome,
) -> None:
    """Run the trials and store their results, until all are done or an end is requested.

    Raises:
        BrokenProcessPool: a process of this machine died.
        CancelledError: the scheduler was lost.
        WorkerVersionError: a worker has another version of the code.

    """
    costs = {trial.key: work(trial, trial.plan) for trial in missing}
    done = count - len(missing)
    task = bar.add_task("", total=sum(costs.values()), done=done, count=count)
    # the longest first, so that no long one runs alone at the end
    ordered = sorted(missing, key=lambda trial: -costs[trial.key])
    sent = [shipped(trial) for trial in ordered]
    for each, future in results(pool, run_shipped, sent, lambda: outcome.interrupted):
        text = _keep(store, each.trial, future, outcome)
        done += 1
        bar.update(task, advance=costs[each.trial.key], description=text, done=done)
        if not is_drawable():
            _print_progress(bar, task, text)


def _break_off(outcome: TrialsOutcome, error: Exception | CancelledError) -> None:
    """Record that the pool is broken."""
    if not outcome.interrupted:
        match error:
            case NotBegunError() | WorkerVersionError():
                text = str(error)
            case CancelledError():
                text = "the scheduler was lost; run the command again when it is back"
            case _:
                text = "a worker process was killed, or ran out of memory; run the command again"
        outcome.failed.append(text)
    outcome.interrupted = True


def _keep(
    store: Store, trial: Trial, future: Future[dict[str, Any]], outcome: TrialsOutcome
) -> str:
    """Store a result or an error, and return a line about it.

    Raises:
        BrokenProcessPool: a process of this machine died.
        CancelledError: the scheduler was lost.
        WorkerVersionError: a worker has another version of the code.

    """
    error = future.exception()
    if isinstance(error, BrokenProcessPool | WorkerVersionError):
        raise error
    if error is not None:
        reason = (str(error).strip() or "no message").splitlines()[0]
        line = f"{trial.label} failed: {type(error).__name__}: {reason}"
        outcome.failed.append(line)
        with (store.folder / ERRORS).open("a", encoding="utf-8") as file:
            file.write(f"{line}\n{''.join(traceback.format_exception(error))}\n")
        return line
    row = future.result()
    store.add(trial, row)
    return f"{trial.label}: {_figure(row)}"


def _figure(row: dict[str, Any]) -> str:
    if row.get("mouth_sweepable") is not None:
        return (
            f"mouth {100 * row['mouth_sweepable']:.1f} % at {row['time_ratio']:.2f}x, "
            f"{row['outcome']}"
        )
    if row.get("offsets"):
        return f"offset {row['offsets'][-1]['offset_mm']:.1f} mm"
    return str(row.get("outcome", "done"))


def _print_progress(bar: Progress, task_id: TaskID, text: str) -> None:
    task = next(task for task in bar.tasks if task.id == task_id)
    inform(f"{task.fields['done']}/{task.fields['count']} {text}; {_time_left(task)}")


def _time_left(task: Task) -> str:
    if task.finished:
        return "done"
    elapsed = task.elapsed
    if not elapsed or not task.completed or task.total is None:
        return "time left unknown"
    left = round(elapsed * (task.total - task.completed) / task.completed)
    if left < 60:  # noqa: PLR2004 - seconds to a minute
        return f"{left} s left"
    hours, minutes = divmod(round(left / 60), 60)
    return f"{hours} h {minutes:02d} min left" if hours else f"{minutes} min left"
