"""Pytest fixtures for users of the virtual sweeper; see docs/ci.md.

Loaded by every pytest where sweepctl is installed, so it imports nothing but pytest until a
fixture is asked for. A module of its own, beside the packages: a project that has a package
``tools`` must still be able to run its tests.
"""

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    from tools.virtual.settings import Settings
    from tools.virtual.sweeper import SimulatedSweeper

MARKER = "sweeper"
LINKS = ("pty", "tcp", "slcan", "udpcan")
READY_S = 60.0
"""From starting the emulator's process to its ``ready``; a machine that is very busy takes long."""
END_S = 20.0
_KEYS: dict[str, type] = {
    "room": str,
    "noise": str,
    "seed": int,
    "faults": list,
    "node": int,
    "link": str,
}
_LIMITS = {"seed": range(1 << 63), "node": range(1, 16)}
_OURS = (
    "protocol.uart.framing",
    "bridge.session.states",
    "sim_device.rig",
    "tools.virtual.sweeper",
)
"""One module of each of our packages, to be told from a package of the same name."""


def pytest_configure(config: pytest.Config) -> None:
    """Declare the marker."""
    config.addinivalue_line(
        "markers",
        f"{MARKER}(room='case-1', noise='typical', seed=0, faults=[...], node=1, link='pty'): "
        "what the fixtures sweeper and sweeper_port are made with",
    )


@pytest.fixture
def sweeper(request: pytest.FixtureRequest) -> SimulatedSweeper:
    """A virtual sweeper with a connected host, in virtual time: run, drive, clean, truth."""
    settings = _settings(request)
    from bridge.errors import BridgeError
    from sim_device.faults.spec import FaultSpecError
    from sim_device.noise import UnknownNoiseLevelError
    from tools.virtual.sweeper import SimulatedSweeper

    try:
        return SimulatedSweeper(settings)
    except (FaultSpecError, UnknownNoiseLevelError, BridgeError) as error:
        message = f"sweeper: {error}"
    pytest.fail(message, pytrace=False)


@pytest.fixture
def sweeper_port(request: pytest.FixtureRequest) -> Iterator[str]:
    """PORT of an emulator in a process of its own and in real time, for as long as the test."""
    settings = _settings(request)
    from tools.virtual.emulator_process import EmulatorError, EmulatorProcess

    try:
        emulator = EmulatorProcess(settings, ready_s=READY_S)
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


def _check_names() -> None:
    """Fail in one line where a package of the project's own hides one of ours."""
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


def _settings(request: pytest.FixtureRequest) -> Settings:
    _check_names()
    from tools.virtual.settings import Settings

    values: dict[str, Any] = {}
    for mark in reversed(list(request.node.iter_markers(MARKER))):  # the nearest has the last word
        if mark.args:
            pytest.fail(f"@pytest.mark.{MARKER}: write name=value", pytrace=False)
        values |= mark.kwargs
    for name, value in values.items():
        kind = _KEYS.get(name)
        if kind is None:
            known = ", ".join(_KEYS)
            pytest.fail(f"@pytest.mark.{MARKER}: no {name!r}; there are {known}", pytrace=False)
        other = {"room": Path, "faults": tuple}.get(name, kind)
        if not isinstance(value, kind | other) or isinstance(value, bool):
            text = f"@pytest.mark.{MARKER}: {name}={value!r} is not {kind.__name__}"
            pytest.fail(text, pytrace=False)
        if name in _LIMITS and value not in _LIMITS[name]:
            low, high = _LIMITS[name][0], _LIMITS[name][-1]
            text = f"@pytest.mark.{MARKER}: {name}={value} is not in {low} to {high}"
            pytest.fail(text, pytrace=False)
    faults = values.get("faults", [])
    if not all(isinstance(fault, str) for fault in faults):
        pytest.fail(f"@pytest.mark.{MARKER}: faults={faults!r} is no list of str", pytrace=False)
    if values.get("link", "pty") not in LINKS:
        text = f"@pytest.mark.{MARKER}: link {values['link']!r} is not one of {', '.join(LINKS)}"
        pytest.fail(text, pytrace=False)
    values["room"] = str(values.get("room", "case-1"))
    values["faults"] = tuple(values.get("faults", ()))
    return Settings(**values)


# ---- in the project's own tree ----------------------------------------------------------


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_load_initial_conftests(
    early_config: pytest.Config, args: list[str]
) -> Generator[None, object, object]:
    """Let ``pytest --port /dev/ttyUSB0`` mean the same as ``--port=/dev/ttyUSB0``.

    pytest takes an existing path after an option that it does not know yet for the tests to
    run, and its folder for the project. Only in the project's own tree, whose tests have the
    option; before the output is captured, as a new process does not inherit what was.
    """
    suite = early_config.invocation_params.dir / "tests" / "conformance" / "floor.json"
    if "--port" in args[:-1] and suite.is_file():
        at = args.index("--port")
        joined = [*args[:at], f"--port={args[at + 1]}", *args[at + 2 :]]
        sys.stdout.flush()
        os.execv(sys.executable, [sys.executable, "-m", "pytest", *joined])  # noqa: S606 - no shell wanted
    return (yield)
