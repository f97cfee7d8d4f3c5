"""Runs trials in several processes: progress, Ctrl-C, and errors by the trial's name."""

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
from tools.experiment.trials import room_of, work

if TYPE_CHECKING:
    from rich.progress import Task, TaskID

    from tools.experiment.store import Store
    from tools.experiment.trials import Trial

_SPEED_OVER_S = 1800.0
"""The time left is told from the pace of so long."""
_LOOK_S = 0.2
"""How often it is looked whether the runs are to end."""
ERRORS = "errors.txt"


@dataclass(slots=True)
class Outcome:
    """How a batch of trials went."""

    interrupted: bool = False
    failed: list[str] = field(default_factory=list)
    """One line each: the trial and what went wrong."""


class NotBegunError(BrokenProcessPool):
    """The system refused a process; the text says why."""


class _Left(ProgressColumn):
    """The time left."""

    def render(self, task: Task) -> Text:
        """As words."""
        return Text(_time_left(task), style="progress.remaining")


def run_all(store: Store, trials: list[Trial], jobs: int | None) -> Outcome:
    """Run what is missing in the store. A trial that fails is told, and the others go on.

    Ctrl-C (or SIGTERM) ends the runs. It is looked for between two waits, not raised: an
    exception while the pool is begun or ended leaves processes that wait for each other for ever.
    """
    missing = store.missing(trials)
    outcome = Outcome()
    if not missing:
        return outcome
    costs = {trial: work(trial, room_of(trial.room)) for trial in missing}
    columns = (
        TextColumn("{task.fields[done]}/{task.fields[count]}"),
        BarColumn(),
        TimeElapsedColumn(),
        _Left(),
        TextColumn("{task.description}"),
    )
    # Begun afresh, not forked: this process has threads by now.
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
            inform(f"{done}/{len(trials)} runs done, {workers} at a time from here")
        try:
            # the longest first: none of them is left alone at the end
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
            # waited for: no process of ours is left to end while the interpreter does
            pool.shutdown(cancel_futures=True)
    return outcome


def _submit(pool: ProcessPoolExecutor, trials: list[Trial]) -> dict[Future[dict[str, Any]], Trial]:
    """Begin the workers and give them what to do.

    No signal comes before a worker is prepared for it: one that dies takes the pool with it.

    Raises:
        BrokenProcessPool: A worker died.
        NotBegunError: A worker could not be begun.

    """
    try:
        with held_back():
            return {pool.submit(run_until_ended, trial): trial for trial in trials}
    except OSError as error:
        if error.errno is None:  # a pipe of the pool, which closes them when a worker dies
            raise BrokenProcessPool from error
        raise NotBegunError(f"no more worker processes could be begun: {error}") from error


def _break_off(outcome: Outcome, error: BrokenProcessPool) -> None:
    """Take note that the pool is broken."""
    if not outcome.interrupted:
        ended = "a worker process was ended from outside, or had no memory"
        outcome.failed.append(str(error) if isinstance(error, NotBegunError) else ended)
    outcome.interrupted = True


def _keep(store: Store, trial: Trial, future: Future[dict[str, Any]], outcome: Outcome) -> str:
    """Store a result, or note what went wrong; what to say of it."""
    error = future.exception()
    if isinstance(error, BrokenProcessPool):
        raise error
    if error is not None:
        reason = (str(error).strip() or "no reason given").splitlines()[0]
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
        return f"{row['offsets'][-1]['offset_mm']:.1f} mm off"
    return str(row.get("outcome", "done"))


def _print_progress(bar: Progress, task_id: TaskID, text: str) -> None:
    task = next(task for task in bar.tasks if task.id == task_id)
    inform(f"{task.fields['done']}/{task.fields['count']} {text}; {_time_left(task)}")


def _time_left(task: Task) -> str:
    if task.finished:
        return "done"
    elapsed = task.elapsed
    if not elapsed or not task.completed or task.total is None:
        return "time left not known yet"
    left = round(elapsed * (task.total - task.completed) / task.completed)
    if left < 60:  # noqa: PLR2004 - seconds to a minute
        return f"{left} s left"
    hours, minutes = divmod(round(left / 60), 60)
    return f"{hours} h {minutes:02d} min left" if hours else f"{minutes} min left"
