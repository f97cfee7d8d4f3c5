"""``@pytest.mark.needs("tshark")``: skip a test whose tool is missing, and report it at the end.

With ``--require-tools`` each such test fails instead, with a message of one line. A test that
starts a system program without this mark fails, even if the program is installed: see
``check_start``.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from support.root import ROOT
from support.tools import (
    BASE,
    PROGRAMS,
    TOOLS,
    Tool,
    distribution,
    install_command,
    startable,
    tool_named,
)

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Mapping

MISSING = "missing-tool"
"""Key of a report's property that names the missing tool of a skipped test."""
_STARTS = {"subprocess.Popen", "os.posix_spawn", "os.exec"}
"""Audit events at the start of a program; the program is the first argument."""


def add_options(parser: pytest.Parser) -> None:
    group = parser.getgroup("system tools")
    group.addoption(
        "--require-tools",
        action="store_true",
        help="a test that needs a missing system tool fails instead of being skipped",
    )
    group.addoption(
        "--results",
        type=Path,
        metavar="FILE",
        help="write the counts to FILE as JSON, and leave the closing block to its reader",
    )


def configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers", "needs(*tools): system tools of tests/support/tools.py; skipped without them"
    )
    config.pluginmanager.register(_Needs(config), "sweepctl-needs")


def needed(item: pytest.Item) -> list[Tool]:
    """Return the tools that an item's marks name, each once."""
    names = (name for mark in item.iter_markers("needs") for name in mark.args)
    return [tool_named(name) for name in dict.fromkeys(names)]


class _Needs:
    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._item: pytest.Item | None = None
        self._setting_up: list[pytest.FixtureDef[object]] = []
        self._started_by: dict[object, set[str]] = {}
        """Tools whose programs started in the setup of a fixture; the key is the FixtureDef."""
        self._seconds: defaultdict[str, float] = defaultdict(float)
        """Duration of the tests in each file, s."""
        sys.addaudithook(self._audit)

    # ---- marks ----------------------------------------------------------------------------

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        missing = [tool for tool in needed(item) if not tool.present()]
        if not missing:
            return
        names = ", ".join(tool.name for tool in missing)
        if self._config.getoption("--require-tools"):
            how = install_command(missing, distribution())
            pytest.fail(f"missing system tool: {names}; install: {how}", pytrace=False)
        item.user_properties.extend((MISSING, tool.name) for tool in missing)
        pytest.skip(f"missing system tool: {names}")

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        if report.when == "setup" and report.failed and not all(t.present() for t in needed(item)):
            report.when = "call"  # a failure of the test, not an error of a fixture
        return report

    # ---- starts ---------------------------------------------------------------------------

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        self._item = item
        try:
            return (yield)
        finally:
            self._item = None

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(
        self, fixturedef: pytest.FixtureDef[object]
    ) -> Generator[None, object, object]:
        self._setting_up.append(fixturedef)
        self._started_by.pop(fixturedef, None)  # left by another parameter of this fixture
        try:
            return (yield)
        finally:
            self._setting_up.pop()

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_call(self, item: pytest.Item) -> None:
        """Check the programs of shared fixtures, in every test that uses such a fixture."""
        if not isinstance(item, pytest.Function):
            return
        marked = {tool.name for tool in needed(item)}
        for name in item.fixturenames:
            for fixture in item._fixtureinfo.name2fixturedefs.get(name, ()):  # noqa: SLF001 - pytest has no public way from an item to its fixtures
                if unmarked := self._started_by.get(fixture, set()) - marked:
                    _reject(f"its fixture {name} starts {', '.join(unmarked)}", unmarked)

    def _audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event in _STARTS and self._item is not None:
            marked = {tool.name for tool in needed(self._item)}
            started = check_start(os.fsdecode(arguments[0]), marked | startable())
            if started is not None and started.name in marked:
                for fixture in self._setting_up:
                    self._started_by.setdefault(fixture, set()).add(started.name)

    # ---- the end --------------------------------------------------------------------------

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._seconds[report.nodeid.partition("::")[0]] += report.duration

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        stats = terminalreporter.stats
        skipped = [report.user_properties for report in stats.get("skipped", ())]
        not_run = Counter(
            tuple(sorted({str(value) for key, value in properties if key == MISSING}))
            for properties in skipped
        )
        results: Path | None = self._config.getoption("--results")
        if results is None:
            for line in block(not_run):
                terminalreporter.write_line(line)
            return
        counts = {
            "passed": len(stats.get("passed", ())),
            "failed": len(stats.get("failed", ())) + len(stats.get("error", ())),
            "skipped": len(skipped),
            "not_run": [[list(names), n] for names, n in not_run.items() if names],
            "seconds": self._seconds,
        }
        results.write_text(json.dumps(counts), encoding="utf-8")


def check_start(program: str, marked: Iterable[str]) -> Tool | None:
    """Return the tool of a started program; None if it needs no mark.

    Python, programs beside it, in the checkout or built by a test need no mark. A missing program
    needs none either.
    """
    path = shutil.which(program)
    if path is None or Path(path).name in BASE:
        return None
    own = (sys.prefix, sys.base_prefix, str(ROOT), tempfile.gettempdir(), sys.executable)
    if any(Path(path).is_relative_to(place) for place in own if place != "/usr"):
        return None
    name = Path(path).name
    if name.startswith("python"):
        return None
    tool = PROGRAMS.get(name)
    if tool is None:
        pytest.fail(f"starts {name}, which tests/support/tools.py does not have", pytrace=False)
    if tool.name not in marked:
        _reject(f"starts {name}", {tool.name})
    return tool


def _reject(what: str, names: set[str]) -> None:
    marks = ", ".join(f'"{name}"' for name in sorted(names))
    pytest.fail(f"{what} without the mark needs({marks})", pytrace=False)


def block(not_run: Mapping[tuple[str, ...], int]) -> list[str]:
    """Return lines for the end of a run: skipped tests by tool, and the install command."""
    by_tool: Counter[str] = Counter()
    for names, count in not_run.items():
        for name in names:
            by_tool[name] += count
    tools = [tool for tool in TOOLS if by_tool[tool.name]]
    if not tools:
        return []
    total = sum(count for names, count in not_run.items() if names)
    width = max(len(tool.name) for tool in tools)
    return [
        "",
        f"not run, for want of a system tool: {total} tests",
        *(f"  {tool.name:<{width}}  {by_tool[tool.name]:>4}  {tool.use}" for tool in tools),
        f"install them: {install_command(tools, distribution())}",
    ]
