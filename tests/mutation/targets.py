"""Targets of the mutation run, and the fast tests that must detect the mutants."""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import dataclass
from pathlib import Path

from support.root import ROOT

_UNIT = "tests/unit"


@dataclass(frozen=True)
class Target:
    """A module, its excluded parts, and the tests that must detect its mutants."""

    name: str
    module: str
    tests: tuple[str, ...]
    exclude: frozenset[str] = frozenset()
    covered: float = 100.0
    """Minimum branch coverage by its tests, percent; below it ``mutation.covered`` fails."""
    unexamined: int = 0
    """Allowed number of survivors of a whole run that are not examined yet."""

    @property
    def relative(self) -> Path:
        """Path of its source, from the root."""
        return Path(f"{self.module.replace('.', '/')}.py")

    @property
    def path(self) -> Path:
        """Path of its source."""
        return ROOT / self.relative

    @property
    def digest(self) -> str:
        """Digest of its source and its tests; a result with another digest is invalid."""
        sources = [self.path, *(ROOT / test for test in self.tests), Path(__file__)]
        text = b"".join(path.read_bytes() for path in sources)
        return hashlib.sha256(text).hexdigest()[:16]


def _tests(*names: str) -> tuple[str, ...]:
    """Return paths of test files, each given as ``folder/name``."""
    places = (name.rpartition("/")[::2] for name in names)
    return tuple(f"{_UNIT}/{folder}/test_{name}.py" for folder, name in places)


TARGETS = (
    Target("latch", "sim_device.device.latch", _tests("sim_device/device/latch")),
    Target(
        "freshness", "sim_device.device.freshness", _tests("sim_device/device/freshness_limits")
    ),
    Target("watchdog", "sim_device.device.watchdog", _tests("sim_device/device/watchdog")),
    Target(
        "modes",
        "sim_device.device.modes",
        _tests("sim_device/device/mode_table", "sim_device/device/modes"),
        frozenset({"drawn", "rejections"}),  # code that only prints
    ),
    Target(
        "mission",
        "bridge.run.mission",
        _tests(
            "run/mission",
            "run/mission_loss",
            "run/mission_ends",
            "session/link_latency",
            "session/stale_samples",
            "session/again",
        ),
        covered=96.0,
    ),
    Target("measured", "bridge.supervise.measured", _tests("supervise/measured")),
    Target(
        "slip", "bridge.supervise.rules.slip", _tests("supervise/slip", "supervise/slip_limits")
    ),
    Target(
        "bodily",
        "bridge.supervise.rules.bodily",
        _tests("supervise/bodily", "supervise/bodily_limits"),
    ),
    Target(
        "progress",
        "bridge.supervise.rules.progress",
        _tests("supervise/progress", "supervise/bodily_limits"),
    ),
    Target(
        "fence",
        "bridge.supervise.rules.fence",
        _tests("supervise/fence", "supervise/bodily_limits"),
    ),
    Target("electric", "bridge.supervise.rules.electric", _tests("supervise/electric")),
    Target(
        "planner_check",
        "bridge.supervise.rules.planner_check",
        _tests("supervise/planner_check", "supervise/planner_check_limits"),
    ),
    Target("supervisor", "bridge.supervise.supervisor", _tests("supervise/grading")),
    Target(
        "dead_man_switch",
        "bridge.run.dead_man_switch",
        _tests("run/dead_man_switch_velocities", "run/dead_man_switch"),
    ),
    Target("stopping", "bridge.io.stopping", _tests("session/stopping_alone")),
    Target("port_loop", "bridge.io.port_loop", _tests("session/stopping_alone", "io/port_loop")),
    Target("stop", "bridge.session.stop_request", _tests("session/stopping_alone")),
    Target(
        "host",
        "bridge.run.host",
        (
            *_tests(
                *("run/run", "run/disturbances", "run/parameters", "run/warming", "run/summary"),
                *(
                    "session/link_latency",
                    "session/stale_samples",
                    "record/damaged_records",
                    "session/again",
                ),
                "api/shared_between_threads",
            ),
            "tests/scenario/test_supervise_onboard.py",
        ),
        covered=95.0,
        unexamined=190,  # of 416 mutants; an estimate, because 22 of a share of 48 survived
    ),
)


def equivalents() -> dict[str, dict[str, str]]:
    """Return, by target, the names of mutants that change nothing, with the proof."""
    with (Path(__file__).parent / "equivalent.toml").open("rb") as file:
        return tomllib.load(file)
