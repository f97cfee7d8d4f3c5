"""Experiments on a Dask cluster of two local workers."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import time
from typing import TYPE_CHECKING, Any

import pyarrow.parquet as pq
import pytest

from support.cli import end, short_runs, start, sweepctl
from support.cluster import Cluster
from tools.cli import pools
from tools.experiment import shipping
from tools.experiment.parts import DETAIL, FOLDER
from tools.experiment.runs import run_all
from tools.experiment.shipping import WorkerVersionError, run_shipped, shipped
from tools.experiment.store import LINES, Store, code_version
from tools.experiment.trials import Trial, grid_trials, with_robots
from tools.experiment.worker import run_trial

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = [pytest.mark.slow, pytest.mark.realtime]

GRID = ("--rooms", "case-1", "--planners", "paper,u-shape", "--max-time", "8", "--seeds", "6")
RUNS = 12


@pytest.fixture(scope="module", name="cluster")
def two_workers() -> Iterator[Cluster]:
    with Cluster(2) as cluster:
        yield cluster


@pytest.fixture(scope="module", name="local")
def local_rows(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """Return the rows of the same runs, computed in this process."""
    store = Store(tmp_path_factory.mktemp("local"), code_version(["paper", "u-shape"]))
    for trial in grid_trials(["case-1"], ["paper", "u-shape"], ["typical"], range(6), 8.0):
        store.add(trial, run_trial(trial))
    return rows(store.folder)


def rows(out: Path) -> list[dict[str, Any]]:
    lines = (out / LINES).read_text().splitlines()
    return sorted(map(json.loads, lines), key=lambda row: str(row["key"]))


def wait_for_lines(out: Path, count: int, process: subprocess.Popen[str]) -> None:
    path = out / LINES
    while not path.exists() or path.read_text().count("\n") < count:
        assert process.poll() is None
        time.sleep(0.02)


def check_dataset(out: Path) -> None:
    """Check that each result is in the dataset exactly once, with equal values."""
    table = pq.read_table(out / FOLDER).to_pylist()
    expected = rows(out)
    assert sorted(row["key"] for row in table) == [row["key"] for row in expected]
    by_key = {row["key"]: row for row in table}
    for row in expected:
        found = by_key[row["key"]]
        detail = json.loads(found.pop(DETAIL))
        assert {name: found[name] for name in row if name not in detail} | detail == row


def test_a_campaign_is_complete_and_the_same_after_a_worker_is_killed(
    tmp_path: Path, cluster: Cluster, local: list[dict[str, Any]]
) -> None:
    words = ("experiment", "compare", *GRID, "--scheduler", cluster.address, "--out", tmp_path)
    process = start(*words, "--json", cwd=tmp_path)
    wait_for_lines(tmp_path, 2, process)
    os.kill(cluster.workers[0], signal.SIGKILL)
    done = end(process)
    assert done.status == 0, done.err
    assert (done.json["runs"], done.json["failed"]) == (RUNS, [])
    assert rows(tmp_path) == local
    check_dataset(tmp_path)
    assert f"0/{RUNS} runs done, 2 workers of {cluster.address}" in done.err
    assert "s left" in done.err


def test_an_interrupted_campaign_continues(
    tmp_path: Path, cluster: Cluster, local: list[dict[str, Any]]
) -> None:
    words = ("experiment", "compare", *GRID, "--scheduler", cluster.address, "--out", tmp_path)
    process = start(*words, cwd=tmp_path)
    wait_for_lines(tmp_path, 2, process)
    done = end(process, signal.SIGINT)
    assert done.status == 0, done.err
    kept = rows(tmp_path)
    assert 2 <= len(kept) < RUNS
    assert f"{len(kept)} of {RUNS} runs done, kept in {tmp_path}" in done.err
    assert end(start(*words, cwd=tmp_path)).status == 0
    assert rows(tmp_path) == local
    assert len(list((tmp_path / FOLDER).glob("part-*.parquet"))) == 2
    check_dataset(tmp_path)


def test_files_of_this_machine_are_sent_to_the_workers(tmp_path: Path, cluster: Cluster) -> None:
    """Workers use another folder, and the files are renamed before the runs start."""
    room, robot = tmp_path / "own.json", tmp_path / "small.toml"
    room.write_text('{"walls": [[0, 0], [3, 0], [3, 2], [0, 2]], "start": [1, 1, 0]}')
    robot.write_text("robot_diameter_m = 0.26\ncleaning_width_m = 0.13\nwheel_base_m = 0.19\n")
    trials = with_robots([Trial(str(room), "u-shape", "none", 0, 4.0)], [str(robot)])
    expected = run_trial(trials[0])
    packed = shipped(trials[0])
    for path in (room, robot):
        path.unlink()
    with pools.ClusterPool(cluster.address) as pool:
        ((_, future),) = pools.results(pool, run_shipped, [packed])
        assert future.result() == expected


def test_a_worker_with_another_version_ends_the_campaign(
    tmp_path: Path, cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shipping, "_version", lambda _planner: "0.0.0-00000000")
    trials = [Trial("case-1", "u-shape", "typical", seed, 2.0) for seed in range(40)]
    outcome = run_all(Store(tmp_path, "1"), trials, None, cluster.address)
    assert outcome.interrupted
    assert len(outcome.failed) == 1
    assert "install the same version of sweepctl on every machine" in outcome.failed[0]


def test_a_trial_that_fails_is_named_and_the_others_go_on(tmp_path: Path, cluster: Cluster) -> None:
    good = Trial("case-1", "u-shape", "none", 0, 1.0)
    bad = Trial("case-1", "no-such-planner", "none", 0, 1.0)
    outcome = run_all(Store(tmp_path, "1"), [bad, good], None, cluster.address)
    assert not outcome.interrupted
    assert len(outcome.failed) == 1
    assert outcome.failed[0].startswith("case-1 no-such-planner none seed 0 failed: Unknown")


def test_a_scheduler_that_is_lost_ends_the_campaign_and_keeps_what_is_done(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with Cluster(1) as cluster:
        words = ("experiment", "compare", *GRID, "--scheduler", cluster.address, "--out", out)
        process = start(*words, cwd=tmp_path)
        wait_for_lines(out, 1, process)
    done = end(process)
    assert done.status == 1
    assert "the scheduler was lost; run the command again when it is back" in done.err
    assert "Traceback" not in done.err
    assert 1 <= len(rows(out)) < RUNS


def test_logs_are_indexed_and_exported_on_the_cluster(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, cluster: Cluster
) -> None:
    for number, recorded in enumerate(short_runs(tmp_path_factory)):
        shutil.copy(recorded.log, tmp_path / f"{number}.mcap")
    where = ("--scheduler", cluster.address, "--json")
    done = sweepctl("runs", "index", tmp_path, *where)
    assert (done.status, done.json) == (0, {"read": 3, "runs": 3, "unreadable": 0})
    files = sorted(tmp_path.glob("*.mcap"))
    done = sweepctl("export", *files, "--out", tmp_path / "out", "--topic", "/pose", *where)
    assert (done.status, done.json["failed"]) == (0, [])
    assert [file["rows"] for file in done.json["files"].values()] == [
        pq.read_metadata(tmp_path / "out" / str(n) / "pose.parquet").num_rows for n in range(3)
    ]


# ---- without a cluster


def test_a_scheduler_that_does_not_answer_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pools, "CONNECT_S", 0.3)
    words = ("experiment", "compare", *GRID, "--out", tmp_path)
    done = sweepctl(*words, "--scheduler", "tcp://127.0.0.1:1")
    assert done.status == 3
    assert "cannot reach the scheduler tcp://127.0.0.1:1: " in done.line


def test_without_the_package_the_error_names_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    words = ("experiment", "compare", *GRID, "--out", tmp_path)
    done = sweepctl(*words, "--scheduler", "tcp://127.0.0.1:1")
    assert (done.status, "pip install 'sweepctl[cluster]'" in done.line) == (1, True)


def test_jobs_are_for_local_processes(tmp_path: Path) -> None:
    words = ("experiment", "compare", *GRID, "--out", tmp_path, "--jobs", "2")
    done = sweepctl(*words, "--scheduler", "tcp://127.0.0.1:1")
    assert (done.status, "--jobs is for local processes" in done.line) == (2, True)


def test_another_version_is_rejected_by_the_worker_itself() -> None:
    trial = Trial("case-1", "u-shape", "none", 0, 1.0)
    with pytest.raises(WorkerVersionError, match=r"but this is 0\.0\.0"):
        run_shipped(shipping.Shipped(trial, "0.0.0", None, None))


def test_the_dataset_follows_the_results_of_the_folder(tmp_path: Path) -> None:
    """A part of discarded results goes, and results that are in no part are added."""
    trials = [Trial("case-1", "u-shape", "none", seed, 1.0) for seed in range(3)]
    store = Store(tmp_path, "1")
    values = {"outcome": "timeout", "path_m": 1, "t90_s": None, "curve": {"coverage": [0.1]}}
    store.add(trials[0], values)
    store.seal()
    store.add(trials[1], values)  # the program is killed before it is sealed
    again = Store(tmp_path, "1")
    again.add(trials[2], values)
    again.seal()
    check_dataset(tmp_path)
    assert len(list((tmp_path / FOLDER).iterdir())) == 2
    shutil.copytree(tmp_path, tmp_path / "copy")
    fresh = Store(tmp_path / "copy", "2", force=True)
    fresh.add(trials[0], values)
    fresh.seal()
    check_dataset(tmp_path / "copy")
