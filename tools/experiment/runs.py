"""Runs trials in several processes: progress, Ctrl-C, and errors by the trial's name."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import traceback
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn, TimeElapsedColumn
from rich.text import Text

from tools.console import err, say
from tools.experiment.ending import prepare_worker, run_until_ended
from tools.experiment.trials import room_of, work

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import FrameType

    from rich.progress import Task, TaskID

    from tools.experiment.store import Store
    from tools.experiment.trials import Trial

_SPEED_OVER_S = 1800.0
"""The time left is told from the pace of so long."""
ERRORS = "errors.txt"


@dataclass(slots=True)
class Outcome:
    """How a batch of trials went."""

    interrupted: bool = False
    failed: list[str] = field(default_factory=list)
    """One line each: the trial and what went wrong."""


class _Left(ProgressColumn):
    """The time left."""

    def render(self, task: Task) -> Text:
        """As words."""
        return Text(_time_left(task), style="progress.remaining")


def run_all(store: Store, trials: list[Trial], jobs: int | None) -> Outcome:
    """Run what is missing in the store. A trial that fails is told, and the others go on."""
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
    with (
        Progress(
            *columns,
            console=err(),
            disable=not err().is_terminal,
            speed_estimate_period=_SPEED_OVER_S,
        ) as bar,
        ProcessPoolExecutor(workers, context, initializer=prepare_worker) as pool,
    ):
        done = len(trials) - len(missing)
        task = bar.add_task("", total=sum(costs.values()), done=done, count=len(trials))
        try:
            # the longest first: none of them is left alone at the end
            ordered = sorted(missing, key=lambda trial: -costs[trial])
            running = {pool.submit(run_until_ended, trial): trial for trial in ordered}
            while running:
                ended, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in ended:
                    trial = running.pop(future)
                    text = _keep(store, trial, future, outcome)
                    done += 1
                    bar.update(task, advance=costs[trial], description=text, done=done)
                    if not err().is_terminal:
                        _tell(bar, task, text)
        except (KeyboardInterrupt, BrokenProcessPool) as error:
            outcome.interrupted = True
            if isinstance(error, BrokenProcessPool):
                outcome.failed.append("a worker process was ended from outside, or had no memory")
            pool.shutdown(wait=False, cancel_futures=True)
            for child in set(multiprocessing.active_children()) - ours:
                child.terminate()
    return outcome


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


def _tell(bar: Progress, task_id: TaskID, text: str) -> None:
    task = next(task for task in bar.tasks if task.id == task_id)
    say(f"{task.fields['done']}/{task.fields['count']} {text}; {_time_left(task)}")


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


@contextlib.contextmanager
def sigterm_interrupts() -> Iterator[None]:
    """Meanwhile let SIGTERM end the runs as Ctrl-C does: what is done is kept, and reported."""

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
