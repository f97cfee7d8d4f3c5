"""What the mutation run changes, and which fast tests are to notice."""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
_UNIT = "tests/unit"


@dataclass(frozen=True)
class Target:
    """A module, what of it is left alone, and the tests that are to notice."""

    name: str
    module: str
    tests: tuple[str, ...]
    exclude: frozenset[str] = frozenset()
    covered: float = 100.0
    """Branch coverage by its tests, percent, below which ``mutation.covered`` fails."""
    unexamined: int = 0
    """Survivors of the whole run that nobody has looked at yet; more of them fail it."""

    @property
    def relative(self) -> Path:
        """Its source, from the root."""
        return Path(f"{self.module.replace('.', '/')}.py")

    @property
    def path(self) -> Path:
        """Of its source."""
        return ROOT / self.relative

    @property
    def digest(self) -> str:
        """Of its source and its tests: a result found with another one is found anew."""
        sources = [self.path, *(ROOT / test for test in self.tests), Path(__file__)]
        text = b"".join(path.read_bytes() for path in sources)
        return hashlib.sha256(text).hexdigest()[:16]


def _tests(*names: str) -> tuple[str, ...]:
    return tuple(f"{_UNIT}/test_{name}.py" for name in names)


TARGETS = (
    Target("latch", "sim_device.device.safety", _tests("safety_limits")),
    Target(
        "modes",
        "sim_device.device.modes",
        _tests("mode_table", "device_modes"),
        frozenset({"drawn", "refusals"}),  # what is printed
    ),
    Target(
        "mission",
        "bridge.run.mission",
        _tests("mission", "mission_loss", "link_latency", "stale_samples", "session_again"),
        covered=96.0,
    ),
    Target("measured", "bridge.supervise.measured", _tests("supervise_measured")),
    Target(
        "slip", "bridge.supervise.rules.slip", _tests("supervise_slip", "supervise_slip_limits")
    ),
    Target(
        "bodily",
        "bridge.supervise.rules.bodily",
        _tests("supervise_bodily", "supervise_bodily_limits"),
    ),
    Target("electric", "bridge.supervise.rules.electric", _tests("supervise_electric")),
    Target(
        "shadow",
        "bridge.supervise.rules.shadow",
        _tests("supervise_shadow", "supervise_shadow_limits"),
    ),
    Target("supervisor", "bridge.supervise.supervisor", _tests("supervise_grading")),
    Target("dead_man", "bridge.run.dead_man", _tests("dead_man_velocities", "dead_man")),
    Target("stopping", "bridge.io.stopping", _tests("stopping_alone")),
    Target("stop", "bridge.session.stop_request", _tests("stopping_alone")),
    Target(
        "host",
        "bridge.run.host",
        _tests(
            *("host_run", "host_disturbances", "host_parameters", "host_warming", "summary"),
            *("link_latency", "stale_samples", "damaged_records", "session_again"),
            "shared_between_threads",
        ),
        covered=95.0,
        unexamined=190,  # of 416, by a share of 48 of which 22 survived
    ),
)


def equivalents() -> dict[str, dict[str, str]]:
    """By target: the names of mutants that change nothing, and why."""
    with (Path(__file__).parent / "equivalent.toml").open("rb") as file:
        return tomllib.load(file)
