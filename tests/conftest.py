"""Settings that every test shares."""

from __future__ import annotations

import os
import signal

import pytest
from hypothesis import HealthCheck, settings

from support import conformance, fairly, needs, targets
from tools.dev import kernels

# The same examples on every run, so that a red CI means a change of the code. No verdict depends on
# the clock (deadline, too_slow), because it would judge the machine.
settings.register_profile(
    "ci",
    derandomize=True,
    database=None,
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
# A search for new failures: HYPOTHESIS_PROFILE=deep make unit ARGS=tests/property
settings.register_profile(
    "deep",
    max_examples=5000,
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))


def pytest_addoption(parser: pytest.Parser) -> None:
    conformance.add_options(parser)
    fairly.add_options(parser)
    needs.add_options(parser)
    targets.add_options(parser)


def pytest_configure(config: pytest.Config) -> None:
    os.environ["SWEEPCTL_CONFIG"] = ""  # ignore the configuration of this machine's user
    text = kernels.complaint(kernels.sources(tests=True))
    if text is not None:
        raise pytest.UsageError(text)
    # A shell's background job or nohup ignores SIGINT, and every process that tests start would
    # too.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    conformance.configure(config)
    needs.configure(config)
    targets.configure(config)
    if config.getoption("--port") is None:
        fairly.configure(config)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    targets.parametrize(metafunc)


@pytest.fixture
def target(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Firmware of the devices of this test: ``python`` or ``core``."""
    name: str = getattr(request, "param", "python")  # a state machine has no parameters
    targets.choose(name, monkeypatch)
    return name
