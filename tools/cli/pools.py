"""Parallel work on many items: in processes of this machine, or on a Dask cluster.

Both kinds of pool return futures of :mod:`concurrent.futures`, so that the same loop can collect
their results.
"""

from __future__ import annotations

import importlib.util
import logging
import multiprocessing
import re
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeVar

from bridge.errors import ArgumentError, BridgeError
from tools.cli.signals import signals_blocked

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from types import TracebackType

CONNECT_S = 10.0
"""Maximum time to reach the scheduler, s."""
_PER_WORKER = 4
"""Number of waiting items per worker, so that no worker is idle during a transfer."""
_LEAST = 32
"""Minimum number of submitted items, because workers may join later."""
_LOOK_S = 0.2
"""Interval at which a request to end is checked, s."""
Item = TypeVar("Item")


class NotBegunError(BrokenProcessPool):
    """The system could not start a process."""


class ClusterMissingError(BridgeError):
    """distributed or pyarrow is not installed."""

    def __init__(self) -> None:
        super().__init__("a cluster needs more packages: pip install 'sweepctl[cluster]'")


_ADDRESS = re.compile(r"(?:(?:tcp|tls|ws|wss)://)?[\w.\-\[\]:]{1,255}:\d{1,5}/?", re.ASCII)
"""Valid addresses of a scheduler. Dask's client may hang on an invalid address."""


class ClusterError(BridgeError):
    """The scheduler cannot be reached."""

    exit_status = 3


class SchedulerAddressError(ArgumentError):
    """The text is not an address of a scheduler."""

    def __init__(self, address: str) -> None:
        super().__init__(f"--scheduler {address[:80]!r} is not an address: use tcp://HOST:PORT")


class Pool(Protocol):
    """Calls a function in parallel. A context manager."""

    where: str
    """Description of the place where the calls run."""
    notes: Sequence[str]
    """Warnings for people."""

    @property
    def window(self) -> int:
        """Maximum number of items that are submitted at a time."""

    def submit(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Sequence[Future[Any]]:
        """Submit a call for each item."""

    def abandon(self) -> None:
        """End the calls that run; their results are lost."""

    def __enter__(self) -> Self:
        """Start."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End."""


class LocalPool:
    """Processes of this machine."""

    def __init__(self, workers: int, prepare: Callable[[], None]) -> None:
        """Use this number of processes; each calls ``prepare`` first."""
        self.where = f"{workers} in parallel"
        self.notes: Sequence[str] = ()
        self.window = max(_LEAST, _PER_WORKER * workers)
        """Maximum number of items that are submitted at a time."""
        self._ours = set(multiprocessing.active_children())
        # Spawned, not forked, because this process has threads.
        context = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(workers, context, initializer=prepare)

    def submit(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Sequence[Future[Any]]:
        """Start the workers and submit a call for each item.

        Signals are blocked until a worker has its handlers, because a worker that dies breaks the
        pool.

        Raises:
            BrokenProcessPool: a worker died.
            NotBegunError: a worker could not be started.

        """
        try:
            with signals_blocked():
                return [self._pool.submit(function, item) for item in items]
        except OSError as error:
            if error.errno is None:  # from a pipe that the pool closed because a worker died
                raise BrokenProcessPool from error
            raise NotBegunError(f"cannot start a worker process: {error}") from error

    def abandon(self) -> None:
        """Terminate the processes, and wait so that none is left when the interpreter exits."""
        for child in set(multiprocessing.active_children()) - self._ours:
            child.terminate()
        self._pool.shutdown(cancel_futures=True)

    def __enter__(self) -> Self:
        """Return itself; the processes start with the first items."""
        self._pool.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Wait for the processes."""
        self._pool.__exit__(kind, error, trace)


class ClusterPool:
    """Workers of a Dask cluster.

    If a worker dies, the scheduler gives its items to another worker.
    """

    def __init__(self, address: str) -> None:
        """Connect to the scheduler, ``HOST:PORT`` or ``tcp://HOST:PORT``.

        Raises:
            ClusterMissingError: distributed or pyarrow is not installed.
            ClusterError: the scheduler cannot be reached.
            SchedulerAddressError: the text is not an address.

        """
        self._client = _connected(address)
        workers = self._client.nthreads()
        self.where = f"{len(workers)} workers of {address}"
        self.notes: Sequence[str] = [
            f"worker {name} has {threads} threads, of which one runs trials; start workers with "
            "--nthreads 1"
            for name, threads in workers.items()
            if threads > 1
        ]
        if not workers:
            self.notes = [f"{address} has no workers yet; the work waits for them"]
        self._executor: Executor = self._client.get_executor(pure=False)
        self._futures: set[Future[Any]] = set()

    @property
    def window(self) -> int:
        """Maximum number of items that are submitted at a time."""
        return max(_LEAST, _PER_WORKER * len(self._client.nthreads()))

    def submit(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Sequence[Future[Any]]:
        """Submit a call for each item."""
        made = [self._executor.submit(function, item) for item in items]
        self._futures = {each for each in self._futures if not each.done()} | set(made)
        return made

    def abandon(self) -> None:
        """Cancel the waiting items. Running calls end on their workers; their results are lost."""
        for future in self._futures:
            future.cancel()

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the connection; the cluster continues."""
        self._client.close()


def results(
    pool: Pool,
    function: Callable[[Any], Any],
    items: Sequence[Item],
    ended: Callable[[], bool] = lambda: False,
) -> Iterator[tuple[Item, Future[Any]]]:
    """Yield each item with its finished future, in the order in which they finish.

    Args:
        pool: where the calls run.
        function: called with each item; it must be importable on a worker.
        items: the calls start in this order.
        ended: checked several times a second; True ends the iteration early.

    Raises:
        BrokenProcessPool: a process of this machine died.

    """
    running: dict[Future[Any], Item] = {}
    begun = 0
    while (begun < len(items) or running) and not ended():
        free = pool.window - len(running)
        if begun < len(items) and free > 0:
            fresh = items[begun : begun + free]
            running |= dict(zip(pool.submit(function, fresh), fresh, strict=True))
            begun += len(fresh)
        finished, _ = wait(running, _LOOK_S, FIRST_COMPLETED)
        for future in finished:
            yield running.pop(future), future


def _connected(address: str) -> Any:  # noqa: ANN401 - distributed is optional
    """Return a client of the scheduler.

    Raises:
        ClusterMissingError: distributed or pyarrow is not installed.
        ClusterError: the scheduler cannot be reached.
        SchedulerAddressError: the text is not an address.

    """
    if not _ADDRESS.fullmatch(address):
        raise SchedulerAddressError(address)
    if not all(map(importlib.util.find_spec, ("distributed", "pyarrow"))):
        raise ClusterMissingError
    import distributed

    # The log lines of distributed about lost workers would disturb the progress display. Each of
    # its loggers has its own level.
    for name in ["distributed", *logging.root.manager.loggerDict]:
        if name.partition(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        return distributed.Client(  # type: ignore[no-untyped-call]  # without types
            address, timeout=CONNECT_S, set_as_default=False
        )
    except (OSError, ValueError, TimeoutError) as error:
        reason = (str(error).strip() or "no answer").splitlines()[0]
        raise ClusterError(f"cannot reach the scheduler {address}: {reason}") from None
