"""A worker process that receives a signal aborts only its trial."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap

import pytest

from support.cli import PATIENCE_S
from support.root import ROOT

AS_A_WORKER = """
import os, signal
from tools.experiment import ending
from tools.experiment.trials import Trial

TRIAL = Trial("case-1", "u-shape", "none", 0, 1.0)
ending.GRACE_S = 0.2

def reported(_trial=None):
    os.kill(os.getpid(), signal.SIGTERM)
    return {}

ending.prepare_worker()
"""


def worker(script: str) -> subprocess.CompletedProcess[str]:
    return python(AS_A_WORKER + textwrap.dedent(script))


def python(script: str, standard_input: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        input=standard_input,
        check=False,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )


def test_a_running_trial_is_aborted_silently() -> None:
    done = worker("""
        ending.run_trial = reported
        ending.run_until_ended(TRIAL)
        print("ran to its end")
    """)
    assert (done.returncode, done.stdout, done.stderr) == (1, "", "")


def test_between_trials_nothing_is_broken_off_and_no_other_begins() -> None:
    done = worker("""
        ending.GRACE_S = 60.0  # of a busy machine: this one ends by itself
        ending.run_trial = lambda _trial: print("ran") or {}
        print(ending.run_until_ended(TRIAL))
        reported()  # as while a result is reported: it goes on
        try:
            ending.run_until_ended(TRIAL)
        except ending.EndedEarlyError:
            print("not begun")
    """)
    assert (done.returncode, done.stdout.splitlines()) == (0, ["ran", "{}", "not begun"])


@pytest.mark.skipif(
    not hasattr(signal, "SIGALRM"), reason="on Windows, a signal ends a process at once"
)
def test_one_that_waits_for_ever_is_ended_all_the_same() -> None:
    done = worker("""
        reported()
        os.read(os.pipe()[0], 1)
    """)
    assert done.returncode == -signal.SIGALRM


@pytest.mark.skipif(sys.platform == "win32", reason="Windows cannot block signals")
def test_signals_wait_until_a_worker_is_prepared() -> None:
    """Signals that arrive while the parent starts a worker do not end the worker."""
    begin = """
        import signal, subprocess, sys
        from multiprocessing import resource_tracker
        from tools.cli.signals import signals_blocked
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
        with signals_blocked():
            resource_tracker.ensure_running()  # as a pool does before it begins a process
            child = subprocess.Popen([sys.executable, "-c", sys.stdin.read()])
        assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == before
        sys.exit(child.wait())
    """
    unprepared = """
        import os, signal
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGTERM)
        from tools.experiment import ending
        ending.GRACE_S = 60.0
        print("not prepared yet", ending.EarlyEnd.asked)
        ending.prepare_worker()
        held = signal.pthread_sigmask(signal.SIG_BLOCK, [])
        ours = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
        print("prepared", ending.EarlyEnd.asked, held & ours)
    """
    done = python(textwrap.dedent(begin), standard_input=textwrap.dedent(unprepared))
    expected = ["not prepared yet False", "prepared True set()"]
    assert (done.returncode, done.stdout.splitlines(), done.stderr) == (0, expected, "")


def test_ctrl_c_is_the_parents() -> None:
    done = worker("""
        os.kill(os.getpid(), signal.SIGINT)
        print("goes on")
    """)
    assert (done.returncode, done.stdout) == (0, "goes on\n")
