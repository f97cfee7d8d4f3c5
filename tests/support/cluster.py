"""A Dask cluster on this machine in separate processes: ``python -m support.cluster N``."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING, Self

from support.processes import environment
from support.root import ROOT

if TYPE_CHECKING:
    from types import TracebackType


class Cluster:
    """A scheduler with workers. A worker that is killed is replaced."""

    def __init__(self, workers: int) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "support.cluster", str(workers)],
            env=environment(PYTHONPATH=f"{ROOT / 'tests'}:{ROOT}"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self._process.stdout is not None
        self.address, *pids = self._process.stdout.readline().split()
        self.scheduler = self._process.pid
        """Process id of the scheduler."""
        self.workers = [int(pid) for pid in pids]
        """Process ids of the first workers."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.communicate()  # the process ends when its input ends


def main() -> None:
    """Run until the input ends."""
    from distributed import LocalCluster  # noqa: PLC0415 - only this process needs it

    with LocalCluster(  # type: ignore[no-untyped-call]  # without types
        n_workers=int(sys.argv[1]),
        threads_per_worker=1,
        dashboard_address=None,
        worker_dashboard_address=None,
    ) as cluster:
        pids = [str(worker.pid) for worker in cluster.workers.values()]
        sys.stdout.write(" ".join([cluster.scheduler_address, *pids]) + "\n")
        sys.stdout.flush()
        sys.stdin.read()


if __name__ == "__main__":
    main()
