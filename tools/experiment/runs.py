"""Runs trials in several processes, with progress, Ctrl-C and errors by trial."""

from __future__ import annotations

import multiprocessing
import os
import traceback
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn, TimeElapsedColumn
from rich.text import Text

from tools.cli.console import err, inform, is_drawable
from tools.cli.signals import held_back, until_signalled
from tools.experiment.ending import prepare_worker, run_until_ended
from tools.experiment.trials import work

if TYPE_CHECKING:
    from rich.progress import Task, TaskID

    from tools.experiment.store import Store
    from tools.experiment.trials import Trial

_SPEED_OVER_S = 1800.0
"""Period over which the speed for the remaining time is averaged, s."""
_LOOK_S = 0.2
"""Period at which a request to end is checked, s."""
ERRORS = "errors.txt"
"""File in the experiment's folder with the tracebacks of failed trials."""


@dataclass(slots=True)
class Outcome:
    """Result of a batch of trials."""

    interrupted: bool = False
    """The runs were ended before all trials were done."""
    failed: list[str] = field(default_factory=list)
    """A line for each failed trial with its error."""


class NotBegunError(BrokenProcessPool):
    """The system could not start a process."""


class _Left(ProgressColumn):
    """Progress column with the remaining time."""

    def render(self, task: Task) -> Text:
        """Return the remaining time."""
        return Text(_time_left(task), style="progress.remaining")


def run_all(store: Store, trials: list[Trial], jobs: int | None) -> Outcome:
    """Run the trials that the store lacks. A failed trial is reported, and the others continue.

    Ctrl-C or SIGTERM ends the runs. The signal is polled instead of raised: an exception while the
    pool starts or ends would leave processes that wait for each other for ever.

    Args:
        store: takes the results.
        trials: what to run.
        jobs: number of processes; None: one per core.

    """
    missing = store.missing(trials)
    outcome = Outcome()
    if not missing:
        return outcome
    costs = {trial: work(trial, trial.plan) for trial in missing}
    columns = (
        TextColumn("{task.fields[done]}/{task.fields[count]}"),
        BarColumn(),
        TimeElapsedColumn(),
        _Left(),
        TextColumn("{task.description}"),
    )
    # Spawned, not forked, because this process has threads.
    context = multiprocessing.get_context("spawn")
    workers = min(jobs or os.cpu_count() or 1, len(missing))
    ours = set(multiprocessing.active_children())

    def end() -> None:
        outcome.interrupted = True

    with (
        until_signalled(end),
        Progress(
            *columns,
            console=err(),
            disable=not is_drawable(),
            speed_estimate_period=_SPEED_OVER_S,
        ) as bar,
        ProcessPoolExecutor(workers, context, initializer=prepare_worker) as pool,
    ):
        done = len(trials) - len(missing)
        task = bar.add_task("", total=sum(costs.values()), done=done, count=len(trials))
        if not is_drawable():
            inform(f"{done}/{len(trials)} runs done, {workers} in parallel")
        try:
            # the longest first, so that no long one runs alone at the end
            ordered = sorted(missing, key=lambda trial: -costs[trial])
            running = _submit(pool, ordered)
            while running and not outcome.interrupted:
                ended, _ = wait(running, _LOOK_S, FIRST_COMPLETED)
                for future in ended:
                    trial = running.pop(future)
                    text = _keep(store, trial, future, outcome)
                    done += 1
                    bar.update(task, advance=costs[trial], description=text, done=done)
                    if not is_drawable():
                        _print_progress(bar, task, text)
        except BrokenProcessPool as error:
            _break_off(outcome, error)
        if outcome.interrupted:
            for child in set(multiprocessing.active_children()) - ours:
                child.terminate()
            # wait, so that no child process is left when the interpreter exits
            pool.shutdown(cancel_futures=True)
    return outcome


def _submit(pool: ProcessPoolExecutor, trials: list[Trial]) -> dict[Future[dict[str, Any]], Trial]:
    """Start the workers and submit the trials.

    Signals are blocked until a worker has its handlers: a worker that dies breaks the pool.

    Raises:
        BrokenProcessPool: a worker died.
        NotBegunError: a worker could not be started.

    """
    try:
        with held_back():
            return {pool.submit(run_until_ended, trial): trial for trial in trials}
    except OSError as error:
        if error.errno is None:  # from a pipe that the pool closed because a worker died
            raise BrokenProcessPool from error
        raise NotBegunError(f"cannot start a worker process: {error}") from error


def _break_off(outcome: Outcome, error: BrokenProcessPool) -> None:
    """Record that the pool is broken."""
    if not outcome.interrupted:
        ended = "a worker process was killed, or ran out of memory; run the command again"
        outcome.failed.append(str(error) if isinstance(error, NotBegunError) else ended)
    outcome.interrupted = True


def _keep(store: Store, trial: Trial, future: Future[dict[str, Any]], outcome: Outcome) -> str:
    """Store a result or an error, and return a line about it."""
    error = future.exception()
    if isinstance(error, BrokenProcessPool):
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
