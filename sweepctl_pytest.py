"""Pytest fixtures for users of the virtual sweeper; see docs/ci.md.

Every pytest with sweepctl installed loads this module, so it imports only pytest until a fixture is
used. It is a module beside the packages, so that a project with its own package ``tools`` can still
run its tests.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    from tools.virtual.settings import SweeperSettings
    from tools.virtual.simulated_sweeper import SimulatedSweeper

MARKER = "sweeper"
LINKS = ("pty", "tcp", "slcan", "udpcan")
TARGETS = ("python", "core")
READY_S = 60.0
"""Maximum time from the start of the emulator's process to its ``ready``, s; a busy machine is
slow."""
END_S = 20.0
_RECORD = "record"
"""Key of the marker that keeps the log of a failed test."""
_KEPT = "runs"
"""Folder of kept logs, below pytest's root folder: the one that ``sweepctl runs`` lists."""
_NAME_LETTERS = 150
"""Longest name of a kept log, without its suffix; file systems allow 255 bytes."""
_KEYS: dict[str, type] = {
    "room": str,
    "noise": str,
    "seed": int,
    "faults": list,
    "node": int,
    "link": str,
    "target": str,
    "firmware": str,
}
_ALSO: dict[str, tuple[type, ...]] = {"room": (Path,), "faults": (tuple,), "firmware": (Path,)}
"""Other types of a value."""
_CHOICES = {"link": LINKS, "target": TARGETS}
_LIMITS = {"seed": range(1 << 63), "node": range(1, 16)}
_OURS = (
    "protocol.uart.framing",
    "bridge.session.states",
    "sim_device.rig",
    "tools.virtual.simulated_sweeper",
)
"""One module of each of our packages, to distinguish it from a package of the same name."""


def pytest_configure(config: pytest.Config) -> None:
    """Declare the marker."""
    config.addinivalue_line(
        "markers",
        f"{MARKER}(room='case-1', noise='typical', seed=0, faults=[...], node=1, link='pty', "
        "target='python', firmware=None, "
        "record=False): what the fixtures sweeper and sweeper_port are made with; with record=True "
        f"the log of a failed test is kept in {_KEPT}/",
    )


@pytest.fixture
def sweeper(request: pytest.FixtureRequest) -> Iterator[SimulatedSweeper]:
    """A virtual sweeper with a connected host, in virtual time: run, drive, clean, truth."""
    settings = _settings(request)
    from bridge.errors import BridgeError
    from sim_device.core.chip import FirmwareCrashError, FirmwareLibraryError
    from sim_device.faults.spec import FaultSpecError
    from sim_device.noise import UnknownNoiseLevelError
    from tools.virtual.simulated_sweeper import SimulatedSweeper

    try:
        made = SimulatedSweeper(settings)
    except FirmwareCrashError as error:
        message = f"sweeper: {error}\n{error.details}"
    except (FaultSpecError, UnknownNoiseLevelError, FirmwareLibraryError, BridgeError) as error:
        message = f"sweeper: {error}"
    else:
        with _log_of(request) as log:
            if log is not None:
                made.record(log)
            yield made
            made.close()
        return
    pytest.fail(message, pytrace=False)


@pytest.fixture
def sweeper_port(request: pytest.FixtureRequest) -> Iterator[str]:
    """Yield the PORT of an emulator in a separate process, in real time, during the test."""
    settings = _settings(request)
    from tools.virtual.emulator_process import EmulatorError, EmulatorProcess

    with _log_of(request) as log:
        try:
            emulator = EmulatorProcess(settings, ready_s=READY_S, truth=log)
        except EmulatorError as error:
            message = f"sweeper_port: {error}"
        else:
            try:
                yield emulator.port
            finally:
                complaint = emulator.end(END_S)
            if complaint is None:
                return
            message = f"sweeper_port: {complaint}"
    pytest.fail(message, pytrace=False)


# ---- logs of failed tests ---------------------------------------------------------------

_kept_log = pytest.StashKey[Path]()
"""Key of the path where a test's log is kept if the test fails."""
_failed = pytest.StashKey[bool]()


@contextmanager
def _log_of(request: pytest.FixtureRequest) -> Iterator[Path | None]:
    """Yield where to record the test; None: it is not recorded. Keep the log if the test fails."""
    if not _marked(request).get(_RECORD, False):
        yield None
        return
    node = request.node
    name = re.sub(r"[^\w.=+-]+", "-", node.nodeid).strip("-.")[-_NAME_LETTERS:]
    kept = request.config.rootpath / _KEPT / f"{name}.mcap"
    node.stash[_kept_log] = kept
    with tempfile.TemporaryDirectory(prefix="sweepctl-test-") as folder:
        log = Path(folder) / kept.name
        yield log
        if node.stash.get(_failed, False) and log.exists():
            kept.parent.mkdir(exist_ok=True)
            shutil.move(log, kept)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Name the kept log in the report of a failed test."""
    report = yield
    kept = item.stash.get(_kept_log, None)
    if kept is not None and report.failed and call.when != "teardown":
        item.stash[_failed] = True
        text = f"{kept}\nexplain it:  sweepctl report {kept}"
        report.sections.append(("log of the sweeper", text))
    return report


def _check_names() -> None:
    """Fail in one line if a package of the user's project hides one of ours."""
    for module in _OURS:
        package = module.partition(".")[0]
        try:
            found = find_spec(module) is not None
        except ModuleNotFoundError:  # a file `tools.py`, which has no modules in it
            found = False
        if not found:
            where = getattr(sys.modules.get(package), "__file__", None) or "this project"
            text = f"sweepctl's package {package!r} is hidden by another of that name: {where}"
            pytest.fail(text, pytrace=False)


def _marked(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Return the values of a test's markers; the nearest marker has priority."""
    values: dict[str, Any] = {}
    for mark in reversed(list(request.node.iter_markers(MARKER))):
        if mark.args:
            pytest.fail(f"@pytest.mark.{MARKER}: write name=value", pytrace=False)
        values |= mark.kwargs
    return values


def _settings(request: pytest.FixtureRequest) -> SweeperSettings:
    _check_names()
    from tools.virtual.settings import SweeperSettings

    values = {name: value for name, value in _marked(request).items() if value is not None}
    for problem in _problems(values):
        pytest.fail(f"@pytest.mark.{MARKER}: {problem}", pytrace=False)
    values.pop(_RECORD, None)
    if "firmware" in values:
        values["firmware"] = str(values["firmware"])
    values["room"] = str(values.get("room", "case-1"))
    values["faults"] = tuple(values.get("faults", ()))
    try:
        return SweeperSettings(**values)
    except ValueError as error:
        pytest.fail(f"@pytest.mark.{MARKER}: {error}", pytrace=False)


def _problems(values: dict[str, Any]) -> Iterator[str]:
    """Yield what is wrong with the values of the markers."""
    for name, value in values.items():
        kind = bool if name == _RECORD else _KEYS.get(name)
        if kind is None:
            yield f"no {name!r}; there are {', '.join((*_KEYS, _RECORD))}"
        elif kind is bool:
            if not isinstance(value, bool):
                yield f"{_RECORD}={value!r} is neither True nor False"
        elif not isinstance(value, (kind, *_ALSO.get(name, ()))) or isinstance(value, bool):
            yield f"{name}={value!r} is not {kind.__name__}"
        elif name in _LIMITS and value not in _LIMITS[name]:
            yield f"{name}={value} is not in {_LIMITS[name][0]} to {_LIMITS[name][-1]}"
        elif name in _CHOICES and value not in _CHOICES[name]:
            yield f"{name} {value!r} is not one of {', '.join(_CHOICES[name])}"
        elif isinstance(value, list | tuple) and not all(isinstance(v, str) for v in value):
            yield f"faults={value!r} is no list of str"


# ---- in the project's own tree ----------------------------------------------------------


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_load_initial_conftests(
    early_config: pytest.Config, args: list[str]
) -> Generator[None, object, object]:
    """Let ``pytest --port /dev/ttyUSB0`` mean the same as ``--port=/dev/ttyUSB0``.

    After an option that pytest does not know yet, it takes an existing path for the tests to run,
    and the path's folder for the project. The hook acts only in the project's own tree, whose tests
    have the option. It acts before the output is captured, because a new process does not inherit
    earlier output.
    """
    suite = early_config.invocation_params.dir / "tests" / "conformance" / "floor.json"
    if "--port" in args[:-1] and suite.is_file():
        at = args.index("--port")
        joined = [*args[:at], f"--port={args[at + 1]}", *args[at + 2 :]]
        sys.stdout.flush()
        os.execv(sys.executable, [sys.executable, "-m", "pytest", *joined])  # noqa: S606 - no shell wanted
    return (yield)
