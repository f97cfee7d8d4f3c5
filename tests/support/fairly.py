"""A real-time test that fails while the machine is busy runs again: a wrong program fails again."""

from __future__ import annotations

from typing import TYPE_CHECKING

from _pytest.runner import runtestprotocol

from support.hold_up import Busy

if TYPE_CHECKING:
    from collections.abc import Callable

    import pytest

TRIES = 3
AGAIN_S = 35.0
"""A test that took longer than this, s, is not run again: the limit of a test covers all tries."""


class Fairly:
    """Runs real-time tests, and counts those that ran again."""

    def __init__(self, busy: Callable[[], Busy] = Busy) -> None:
        self._busy = busy
        self.again: list[str] = []

    def pytest_runtest_protocol(self, item: pytest.Item, nextitem: pytest.Item | None) -> object:
        if item.get_closest_marker("realtime") is None:
            return None
        hooks = item.ihook
        hooks.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        for left in range(TRIES - 1, -1, -1):
            busy = self._busy()
            reports = runtestprotocol(item, log=False, nextitem=nextitem)
            failed = any(r.failed for r in reports if r.when == "call")
            if not (failed and left and busy.excuses and busy.elapsed_s < AGAIN_S):
                break
            self.again.append(f"{item.nodeid}: {100 * busy.share:.0f} % of the time a task waited")
        for report in reports:
            hooks.pytest_runtest_logreport(report=report)
        hooks.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self.again:
            terminalreporter.section("ran again, because the machine was busy")
            for line in self.again:
                terminalreporter.write_line(line)
