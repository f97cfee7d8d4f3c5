"""Tries a target's mutants, each in a forked process.

The tests are collected once. One forked process runs them all and reports which lines of the target
each of them reaches. A mutant then runs only against the tests that could detect it, the fastest
first. A change within a function is put into that function's code. Code that runs during the import
of the module or the collection of its tests (constants, tables) needs both again. For such a
mutant, the module and all its importers are imported again with the mutant's code.
"""

from __future__ import annotations

import importlib
import os
import pickle
import resource
import signal
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, NoReturn

import pytest

from mutation.patch import Instead, forget, function_of, importers, put_code
from mutation.reach import lines_run
from support.root import ROOT

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import FunctionType, ModuleType

    from mutation.mutator import Mutant
    from mutation.targets import Target

HANGS_S = 120
"""Time limit of a trial, s of real time; the CPU limit ends an endless loop much earlier."""
_OPTIONS = (
    *("-q", "-s", "--no-header", "--tb=no", "--assert=plain"),
    *("-p", "no:cacheprovider", "-o", "timeout=0"),
)
_KILLED, _SURVIVED, _BROKEN = 10, 0, 70


class UnfitError(Exception):
    """The tests fail without any change, or cannot be run."""


@dataclass
class _Reached:
    """Effects of the tests on an unchanged target."""

    cpu_s: dict[str, float] = field(default_factory=dict)
    """CPU time of each test by its id, s."""
    lines: dict[str, set[int]] = field(default_factory=dict)
    """Lines of the target that each test reaches."""
    failed: list[str] = field(default_factory=list)


def try_all(
    target: Target, tried: Sequence[Mutant], on_result: Callable[[Mutant, bool], None]
) -> None:
    """Try mutants of a target, and report for each whether it was killed.

    Call it in a process that ends afterwards: the tests and their imports stay loaded.

    Raises:
        UnfitError: the tests fail without any change.

    """
    early = ExitStack()
    lines = early.enter_context(lines_run(target.path))
    module = importlib.import_module(target.module)
    loop = _Loop(target, module, tried, on_result, lines)
    loop.collected = early.close
    os.chdir(ROOT)
    status = pytest.main([*_OPTIONS, *target.tests], plugins=[loop])
    if loop.unfit or status not in {0, 5}:
        raise UnfitError(loop.unfit or f"pytest ended with {status}")
    stale = importers(target.module)
    stale |= {name for name in sys.modules if name.startswith(("tests.", "test_"))}
    for mutant in loop.anew:
        on_result(mutant, _killed(partial(_import_anew, target, mutant, stale), loop.whole_s))


class _Loop:
    """Replaces pytest's loop: it runs the mutants instead of the tests."""

    def __init__(
        self,
        target: Target,
        module: ModuleType,
        tried: Sequence[Mutant],
        on_result: Callable[[Mutant, bool], None],
        early: set[int],
    ) -> None:
        self._target, self._module, self._tried, self._report = target, module, tried, on_result
        self._early = early
        """Lines that run before any test."""
        self.collected: Callable[[], None]
        """Called once the tests have been collected."""
        self.anew: list[Mutant] = []
        """Mutants that need the module imported again."""
        self.whole_s = 0.0
        """CPU time of all tests, s."""
        self.unfit = ""
        self._failed = False

    def pytest_collection_finish(self) -> None:
        self.collected()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._failed = self._failed or report.failed

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        if session.testsfailed or not session.items:
            self.unfit = "the tests cannot be collected"
            return True
        reached = self._reach(session)
        if reached is None or reached.failed:
            names = ", ".join(reached.failed) if reached else "they end the process"
            self.unfit = f"the tests fail without any change: {names}"
            return True
        self.whole_s = sum(reached.cpu_s.values())
        for mutant in self._tried:
            lines = set(mutant.lines)
            function = None if lines & self._early else function_of(self._module, mutant)
            if function is None:
                self.anew.append(mutant)
                continue
            items = [item for item in session.items if reached.lines[item.nodeid] & lines]
            items.sort(key=lambda item: reached.cpu_s[item.nodeid])
            share_s = sum(reached.cpu_s[item.nodeid] for item in items)
            trial = partial(self._notice, function, mutant, items)
            self._report(mutant, bool(items) and _killed(trial, share_s))
        return True

    def _notice(self, function: FunctionType, mutant: Mutant, items: list[pytest.Item]) -> bool:
        """Return whether any of these tests fails with a mutant."""
        put_code(function, mutant, self._target.path)
        return not all(self._passes(item) for item in items)

    def _reach(self, session: pytest.Session) -> _Reached | None:
        reading, writing = os.pipe()
        pid = os.fork()
        if pid == 0:
            os.close(reading)
            with os.fdopen(writing, "wb") as pipe:
                pipe.write(pickle.dumps(self._run_all(session)))
            os._exit(0)
        os.close(writing)
        with os.fdopen(reading, "rb") as pipe:
            reported = pipe.read()
        os.waitpid(pid, 0)
        return pickle.loads(reported) if reported else None  # noqa: S301 - of our own child

    def _run_all(self, session: pytest.Session) -> _Reached:
        reached = _Reached()
        for item in session.items:
            begun_s = time.process_time()
            with lines_run(self._target.path) as lines:
                passed = self._passes(item)
            reached.cpu_s[item.nodeid] = time.process_time() - begun_s
            reached.lines[item.nodeid] = lines
            if not passed:
                reached.failed.append(item.nodeid)
        return reached

    def _passes(self, item: pytest.Item) -> bool:
        self._failed = False
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=None)
        return not self._failed


def _import_anew(target: Target, mutant: Mutant, stale: set[str]) -> bool:
    forget(stale)
    sys.meta_path.insert(0, Instead(target.module, target.path, mutant))
    return any(pytest.main([*_OPTIONS, "-x", test]) != 0 for test in target.tests)


def _killed(trial: Callable[[], bool], cpu_s: float) -> bool:
    """Return whether a trial in a forked process reports a failure, crashes, or hangs."""
    pid = os.fork()
    if pid == 0:
        _child(trial, cpu_s)
    _, status = os.waitpid(pid, 0)
    code = os.waitstatus_to_exitcode(status)
    if code == _BROKEN:
        raise UnfitError("a mutant could not be put in")
    return code != _SURVIVED


def _child(trial: Callable[[], bool], cpu_s: float) -> NoReturn:
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(HANGS_S)
    limit_s = int(10.0 * cpu_s + 5.0 + time.process_time())
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
    status = _KILLED
    try:
        status = _KILLED if trial() else _SURVIVED
    except LookupError:
        status = _BROKEN
    except BaseException:  # noqa: BLE001, S110 - a mutant may raise any exception during its import
        pass
    finally:
        os._exit(status)
