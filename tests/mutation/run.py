"""Mutation run over the code that keeps the robot safe.

Is every small change to it noticed by a test?

    PYTHONPATH=tests python -m mutation.run                 # all of it
    PYTHONPATH=tests python -m mutation.run --target latch --share 10

Nothing on disk is changed: a mutant lives in the memory of one forked process, where it takes
the place of its module as that is imported. The process runs the target's fast tests until one
fails (the mutant is killed) or all pass (it has survived). Survivors that are known to be
equivalent stand in ``equivalent.toml``, each with the proof; any other fails the run.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.abc
import importlib.util
import io
import os
import signal
import sys
import time
import tomllib
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from mutation.mutator import Mutant, mutants

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from importlib.machinery import ModuleSpec
    from types import ModuleType

ROOT = Path(__file__).parents[2]
TIMEOUT_S = 60
_PYTEST = ("-x", "-q", "-p", "no:cacheprovider", "--no-header", "--tb=no", "--assert=plain")
_UNIT = "tests/unit"
_UNTOUCHED = ("protocol.messages", "protocol.link", "bridge.motion.robot_model")
"""Of ours, what imports no target."""


@dataclass(frozen=True)
class Target:
    """A module, what of it is left alone, and the tests that are to notice."""

    name: str
    module: str
    tests: tuple[str, ...]
    exclude: frozenset[str] = frozenset()

    @property
    def path(self) -> Path:
        """Of its source."""
        return ROOT / f"{self.module.replace('.', '/')}.py"


_RULES, _GRADING, _SHADOW = (
    f"{_UNIT}/test_supervise_{name}.py" for name in ("rules", "grading", "shadow")
)
_TOLD = frozenset({"tell"})
"""What a rule says of itself is held by other tests, of its words."""
TARGETS = (
    Target("latch", "sim_device.safety", (f"{_UNIT}/test_safety_limits.py",)),
    Target(
        "modes",
        "sim_device.modes",
        (f"{_UNIT}/test_device_modes.py",),
        frozenset({"drawn", "refusals"}),
    ),
    Target("mission", "bridge.mission", (f"{_UNIT}/test_mission.py",)),
    Target("measured", "bridge.supervise.measured", (_RULES, _GRADING)),
    Target("slip", "bridge.supervise.slip", (_RULES,), _TOLD),
    Target("bodily", "bridge.supervise.bodily", (_RULES,), _TOLD),
    Target("electric", "bridge.supervise.electric", (_RULES,), _TOLD),
    Target("shadow", "bridge.supervise.shadow", (_SHADOW,), _TOLD),
    Target("supervisor", "bridge.supervise.supervisor", (_GRADING,)),
)


@dataclass
class Tally:
    """What became of a target's mutants."""

    killed: int = 0
    equivalent: list[Mutant] = field(default_factory=list)
    survived: list[Mutant] = field(default_factory=list)
    stale: list[str] = field(default_factory=list)
    """Listed as equivalent, and killed or no mutant any more."""


class _Mutated(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives one module from another source."""

    def __init__(self, module: str, path: Path, source: str) -> None:
        self._module, self._path, self._source = module, path, source

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        del path, target
        if fullname != self._module:
            return None
        return importlib.util.spec_from_loader(fullname, self, origin=str(self._path))

    def exec_module(self, module: ModuleType) -> None:
        exec(compile(self._source, str(self._path), "exec"), module.__dict__)  # noqa: S102 - our own source


def preload() -> None:
    """Import what all tests need and no mutant is of, once for all children."""
    for name in ("hypothesis", "numba", "numpy", "pytest", *_UNTOUCHED):
        importlib.import_module(name)


def passes(target: Target, source: str) -> bool:
    """Whether the target's tests all pass with its module made from this source."""
    pid = os.fork()
    if pid == 0:
        os._exit(_child(target, source))
    deadline = time.monotonic() + TIMEOUT_S
    while time.monotonic() < deadline:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status) == 0
        time.sleep(0.01)
    os.kill(pid, signal.SIGKILL)  # it hangs: that is noticed too
    os.waitpid(pid, 0)
    return False


def _child(target: Target, source: str) -> int:
    import pytest  # noqa: PLC0415 - of the child alone

    sys.meta_path.insert(0, _Mutated(target.module, target.path, source))
    quiet = io.StringIO()
    os.chdir(ROOT)
    try:
        with redirect_stdout(quiet), redirect_stderr(quiet):
            status = pytest.main([*_PYTEST, *target.tests])
    except BaseException:  # noqa: BLE001 - a mutant may raise anything while it is imported
        return 1
    return int(status)


def equivalents() -> dict[str, dict[str, str]]:
    """By target: the names of mutants that change nothing, and why."""
    with (Path(__file__).parent / "equivalent.toml").open("rb") as file:
        return tomllib.load(file)


def examine(target: Target, *, share: int = 1, offset: int = 0, tell: bool = False) -> Tally:
    """Try every ``share``-th mutant of a target, from ``offset`` on."""
    known = equivalents().get(target.name, {})
    source = target.path.read_text()
    if not passes(target, source):
        raise SystemExit(f"{target.name}: its tests fail without any change")
    tally = Tally()
    everything = mutants(source, target.exclude)
    tally.stale = sorted(known.keys() - {mutant.name for mutant in everything})
    for mutant in everything[offset::share]:
        if passes(target, mutant.source):
            listed = mutant.name in known
            (tally.equivalent if listed else tally.survived).append(mutant)
            if tell and not listed:
                print(f"{target.path.relative_to(ROOT)}:{mutant.line}: {mutant.name}", flush=True)
        else:
            tally.killed += 1
            if mutant.name in known:
                tally.stale.append(mutant.name)
    return tally


def main(arguments: Iterable[str] | None = None) -> int:
    """Try the mutants of all targets, or of those named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--target", action="append", choices=[t.name for t in TARGETS])
    parser.add_argument("--share", type=int, default=1, help="try every so many-th mutant only")
    parser.add_argument("--offset", type=int, default=0, help="of a share: where to begin")
    options = parser.parse_args(None if arguments is None else list(arguments))
    sys.path.insert(0, str(ROOT))
    preload()
    bad = False
    for target in TARGETS:
        if options.target and target.name not in options.target:
            continue
        begun_s = time.monotonic()
        tally = examine(target, share=options.share, offset=options.offset, tell=True)
        print(
            f"{target.name:<11}{tally.killed:>5} killed {len(tally.equivalent):>4} equivalent "
            f"{len(tally.survived):>4} survived  {time.monotonic() - begun_s:.0f} s",
            flush=True,
        )
        for name in tally.stale if options.share == 1 else ():
            print(f"  no longer equivalent, take it off the list: {name}")
        bad = bad or bool(tally.survived) or (options.share == 1 and bool(tally.stale))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
