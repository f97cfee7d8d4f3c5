"""Scheduling of real-time tests: in parallel first, then one by one those without a verdict.

Other tests may delay a program until its test fails. Such a failure is no verdict. The test runs
again alone in the next phase, and that run gives the verdict. In that phase, a test that fails
while the machine is busy runs again at once. If the program is wrong, the test fails again.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from _pytest.runner import runtestprotocol
from xdist.scheduler.loadscope import LoadScopeScheduling

from support.hold_up import Busy

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from xdist.remote import Producer

TRIES = 3
AGAIN_S = 35.0
"""Maximum duration of a test that is run again, s; the time limit of a test includes all its tries.
"""
AGAIN, PUT_OFF = "ran-again", "put-off"
"""Keys of a report's properties: a try that did not count, and a test without a verdict yet."""


def add_options(parser: pytest.Parser) -> None:
    group = parser.getgroup("real-time tests")
    group.addoption(
        "--put-off",
        type=Path,
        metavar="FILE",
        help="write real-time tests that failed while the machine was busy to FILE, and do not "
        "count them",
    )
    group.addoption(
        "--alone",
        type=Path,
        metavar="FILE",
        help="of the real-time tests, run those with the mark alone and those that FILE names",
    )


def configure(config: pytest.Config, busy: Callable[[], Busy] = Busy) -> None:
    config.pluginmanager.register(Fairly(config, busy), "sweepctl-fairly")


class Units(LoadScopeScheduling):  # type: ignore[misc]  # xdist has no types
    """Scheduler that gives a worker all tests of a file that share a fixture, else the next test.

    For example, the conformance checks share their devices.
    """

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.partition("::")[0]
        path = self.config.rootpath / file
        if "conformance" in path.parts:
            return "conformance"
        return file if _shares(path) else nodeid


@cache
def _shares(path: Path) -> bool:
    """Return whether a fixture is made for more than one test."""
    return 'scope="' in path.read_text(encoding="utf-8")


class Fairly:
    """Runs real-time tests, and reports those that ran again."""

    def __init__(self, config: pytest.Config, busy: Callable[[], Busy] = Busy) -> None:
        self._busy = busy
        self._put_off: Path | None = config.getoption("--put-off")
        self._alone: Path | None = config.getoption("--alone")

    # ---- selection ------------------------------------------------------------------------

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_make_scheduler(self, config: pytest.Config, log: Producer) -> object | None:
        """Return our scheduler for ``--dist=loadscope``."""
        return Units(config, log) if config.getoption("dist") == "loadscope" else None

    def pytest_collection_modifyitems(
        self, config: pytest.Config, items: list[pytest.Item]
    ) -> None:
        # Short tests run last. After a long last test, one worker would run on alone.
        items.sort(key=lambda item: item.get_closest_marker("slow") is None)
        if self._alone is None:
            return
        named = set(self._alone.read_text(encoding="utf-8").splitlines())
        left_out = [i for i in items if not (i.get_closest_marker("alone") or i.nodeid in named)]
        items[:] = [item for item in items if item not in left_out]
        config.hook.pytest_deselected(items=left_out)

    # ---- running --------------------------------------------------------------------------

    def pytest_runtest_protocol(self, item: pytest.Item, nextitem: pytest.Item | None) -> object:
        if not _is_realtime(item):
            return None
        hooks = item.ihook
        hooks.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        reports = list(self._tries(item, nextitem))
        for report in reports:
            hooks.pytest_runtest_logreport(report=report)
        hooks.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    def _tries(
        self, item: pytest.Item, nextitem: pytest.Item | None
    ) -> Iterator[pytest.TestReport]:
        """Return the reports of the try that counts; its properties list the other tries."""
        notes: list[tuple[str, object]] = []
        for left in range(TRIES - 1, -1, -1):
            busy = self._busy()
            reports = runtestprotocol(item, log=False, nextitem=nextitem)
            failed = [r for r in reports if r.failed]
            if not (failed and busy.excuses):
                break
            text = f"{100 * busy.share:.0f} % of the time a task waited; {_cause(failed[0])}"
            if self._put_off is not None:
                for report in failed:
                    report.outcome = "skipped"
                    report.user_properties.append((PUT_OFF, text))
                break
            if not left or busy.elapsed_s > AGAIN_S or failed[0].when != "call":
                break
            notes.append((AGAIN, text))
        reports[-1].user_properties.extend(notes)
        yield from reports

    # ---- results --------------------------------------------------------------------------

    def pytest_report_teststatus(
        self, report: pytest.TestReport | pytest.CollectReport
    ) -> tuple[str, str, str] | None:
        if _notes(report, PUT_OFF):
            return PUT_OFF, "p", "PUT OFF"
        return None

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        stats = terminalreporter.stats.values()
        reports = [r for kind in stats for r in kind if isinstance(r, pytest.TestReport)]
        if again := [f"{r.nodeid}: {text}" for r in reports for text in _notes(r, AGAIN)]:
            terminalreporter.section("ran again, because the machine was busy")
            terminalreporter.write("\n".join(again) + "\n")
        put_off = {r.nodeid: text for r in reports for text in _notes(r, PUT_OFF)}
        if put_off:
            terminalreporter.section("put off, because the machine was busy")
            for name, text in put_off.items():
                terminalreporter.write_line(f"{name}: {text}")
        if self._put_off is not None:
            self._put_off.write_text("\n".join(put_off), encoding="utf-8")


def _is_realtime(item: pytest.Item) -> bool:
    return item.get_closest_marker("realtime") is not None


def _cause(report: pytest.TestReport) -> str:
    """Return a failure in one line."""
    lines = report.longreprtext.strip().splitlines() or [""]
    return next((line[1:].strip() for line in lines if line.startswith("E ")), lines[-1])


def _notes(report: pytest.TestReport | pytest.CollectReport, kind: str) -> list[Any]:
    properties = report.user_properties if isinstance(report, pytest.TestReport) else ()
    return [value for key, value in properties if key == kind]
