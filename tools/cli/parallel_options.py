"""``--jobs`` and ``--scheduler``: work on many files in parallel."""

from __future__ import annotations

import os
import signal
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

import click

from tools.cli.console import inform

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from tools.cli.pools import Pool

Item = TypeVar("Item")


def parallel_options(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--jobs`` and ``--scheduler``."""
    f = click.option(
        "--scheduler",
        metavar="ADDRESS",
        help="Read the files on the Dask cluster of this scheduler, whose workers must find them "
        "under the same paths.",
    )(f)
    return click.option(
        "--jobs",
        type=click.IntRange(1, 256),
        metavar="N",
        help="Number of parallel processes.  [default: one per core]",
    )(f)


@contextmanager
def pool_of(count: int, jobs: int | None, scheduler: str | None) -> Iterator[Pool]:
    """Start a pool for this number of items.

    Raises:
        click.UsageError: both options were given.
        ClusterMissingError: distributed or pyarrow is not installed.
        ClusterError: the scheduler cannot be reached.
        SchedulerAddressError: the text is not an address.

    """
    from tools.cli.pools import ClusterPool, LocalPool

    if scheduler is not None and jobs is not None:
        raise click.UsageError("--jobs is for local processes: leave it out with --scheduler")
    workers = max(1, min(jobs or os.cpu_count() or 1, count))
    pool: Pool = (
        LocalPool(workers, _ignore_signals) if scheduler is None else ClusterPool(scheduler)
    )
    with pool:
        for note in pool.notes:
            inform(note)
        yield pool


def in_order(
    pool: Pool, function: Callable[[Any], Any], items: Sequence[Item]
) -> Iterator[tuple[Item, Any]]:
    """Yield each item with its result, in the order of the items.

    Raises:
        Exception: what ``function`` raised for an item.

    """
    from tools.cli.pools import results

    numbers = {id(item): number for number, item in enumerate(items)}
    waiting: dict[int, Any] = {}
    due = 0
    for item, future in results(pool, function, items):
        waiting[numbers[id(item)]] = future
        while due in waiting:
            yield items[due], waiting.pop(due).result()
            due += 1


def _ignore_signals() -> None:
    """Ignore Ctrl-C, because the parent process handles it and ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from tools.cli.signals import unblock_signals

    unblock_signals()
