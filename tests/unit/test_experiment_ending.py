"""A worker that is told to end breaks off its trial, and only that."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING, Any

import pytest

from tools.experiment import ending
from tools.experiment.ending import EndedEarlyError, prepare_worker, run_until_ended
from tools.experiment.trials import Trial

if TYPE_CHECKING:
    from collections.abc import Iterator

TRIAL = Trial("case-1", "u-shape", "none", 0, 1.0)


@pytest.fixture(autouse=True)
def _as_a_worker(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    before = [(number, signal.getsignal(number)) for number in (signal.SIGINT, signal.SIGTERM)]
    monkeypatch.setattr(ending.Ending, "asked", False)
    prepare_worker()
    yield
    for number, handler in before:
        signal.signal(number, handler)


def test_a_trial_under_way_is_broken_off(monkeypatch: pytest.MonkeyPatch) -> None:
    def runs_long(_: Trial) -> dict[str, Any]:
        os.kill(os.getpid(), signal.SIGTERM)
        return {"ran": "to its end"}

    monkeypatch.setattr(ending, "run_trial", runs_long)
    with pytest.raises(EndedEarlyError):
        run_until_ended(TRIAL)


def test_between_trials_nothing_is_broken_off_and_no_other_begins(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ran: list[Trial] = []

    def run(trial: Trial) -> dict[str, Any]:
        ran.append(trial)
        return {}

    monkeypatch.setattr(ending, "run_trial", run)
    assert run_until_ended(TRIAL) == {}
    os.kill(os.getpid(), signal.SIGTERM)  # as while a result is told: it goes on
    with pytest.raises(EndedEarlyError):
        run_until_ended(TRIAL)
    assert ran == [TRIAL]
