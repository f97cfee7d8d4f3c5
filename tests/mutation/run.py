"""Mutation run over the safety code: a test must detect every small change to it.

    PYTHONPATH=tests python -m mutation.run                 # all of it
    PYTHONPATH=tests python -m mutation.run --target latch --share 10
    PYTHONPATH=tests python -m mutation.run --keep runs/mutants.jsonl --out docs/mutation.md

Nothing on disk changes. A mutant exists in the memory of one forked process only. This process runs
the tests that reach the mutant. If a test fails, the mutant is killed; if all pass, it has
survived. Equivalent mutants are listed in ``equivalent.toml``, each with its proof. Any other
surviving mutant fails the run. For a module that is not examined yet, ``targets.py`` allows a
number of survivors. With ``--keep`` an interrupted run continues, and mutants whose module and
tests are unchanged are not tried again.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from mutation.mutator import Mutant, mutants
from mutation.page import page
from mutation.targets import TARGETS, Target, equivalents
from mutation.trial import UnfitError, try_all
from support.root import ROOT

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

_UNTOUCHED = ("protocol.messages.device", "protocol.link", "bridge.motion.robot_model")
"""Modules of the product that import no target."""


@dataclass
class Tally:
    """Results of a target's mutants."""

    target: Target
    killed: int = 0
    equivalent: list[Mutant] = field(default_factory=list)
    survived: list[Mutant] = field(default_factory=list)
    stale: list[str] = field(default_factory=list)
    """Mutants listed as equivalent that are killed or no longer exist."""

    def passes(self, *, whole: bool) -> bool:
        """True if no mutant survived, except in modules that may have survivors for now."""
        allowed = self.target.unexamined
        return not self.stale and (len(self.survived) <= allowed or (allowed > 0 and not whole))


class Kept:
    """Results of earlier runs, in a file to which each new result is appended at once."""

    def __init__(self, path: Path | None) -> None:
        """Read the file, if it exists."""
        self._path = path
        self._known: dict[tuple[str, str, str], bool] = {}
        if path is not None and path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                target, digest, name, killed = json.loads(line)
                self._known[target, digest, name] = killed

    def of(self, target: Target, digest: str) -> dict[str, bool]:
        """Return by name whether each mutant was killed, for this digest of module and tests."""
        here = target.name, digest
        return {key[2]: killed for key, killed in self._known.items() if key[:2] == here}

    def add(self, target: Target, digest: str, name: str, *, killed: bool) -> None:
        """Append one result."""
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps([target.name, digest, name, killed]) + "\n")


def preload() -> None:
    """Import the unchanged modules of all tests, once for all child processes."""
    for name in ("hypothesis", "numpy", "pytest", *_UNTOUCHED):
        importlib.import_module(name)


def examine(target: Target, kept: Kept, *, share: int = 1, offset: int = 0) -> Tally:
    """Try every ``share``-th mutant of a target, starting at ``offset``.

    Raises:
        UnfitError: the tests fail without any change.

    """
    digest = target.digest
    everything = mutants(target.path.read_text(encoding="utf-8"), target.exclude)
    chosen = everything[offset::share]
    known = kept.of(target, digest)
    killed = {mutant.name: known[mutant.name] for mutant in chosen if mutant.name in known}
    for name, was_killed in _tried(target, [m for m in chosen if m.name not in killed]):
        killed[name] = was_killed
        kept.add(target, digest, name, killed=was_killed)
    listed = equivalents().get(target.name, {})
    tally = Tally(target)
    tally.stale = sorted(listed.keys() - {mutant.name for mutant in everything})
    for mutant in chosen:
        if not killed[mutant.name]:
            (tally.equivalent if mutant.name in listed else tally.survived).append(mutant)
            continue
        tally.killed += 1
        if mutant.name in listed:
            tally.stale.append(mutant.name)
    return tally


def _tried(target: Target, tried: list[Mutant]) -> Iterator[tuple[str, bool]]:
    """Try mutants in a separate process; yields each name and whether the mutant was killed."""
    if not tried:
        return
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(reading)
        _serve(target, tried, writing)
    os.close(writing)
    with os.fdopen(reading, encoding="utf-8") as pipe:
        for line in pipe:
            reported = json.loads(line)
            if isinstance(reported, str):
                raise UnfitError(f"{target.name}: {reported}")
            yield reported
    if os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) != 0:
        raise UnfitError(f"{target.name}: its process crashed")


def _serve(target: Target, tried: list[Mutant], writing: int) -> None:
    quiet = os.open(os.devnull, os.O_WRONLY)
    for standard in (1, 2):
        os.dup2(quiet, standard)

    def report(reported: object) -> None:
        os.write(writing, (json.dumps(reported) + "\n").encode())

    status = 1
    try:
        try_all(target, tried, lambda mutant, killed: report([mutant.name, killed]))
        status = 0
    except UnfitError as error:
        report(str(error))
    finally:
        os._exit(status)


def main(arguments: Iterable[str] | None = None) -> int:
    """Try the mutants of all targets, or of the named ones."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--target", action="append", choices=[t.name for t in TARGETS])
    parser.add_argument("--share", type=int, default=1, help="try only every N-th mutant")
    parser.add_argument("--offset", type=int, default=0, help="first mutant of a share")
    parser.add_argument("--keep", type=Path, help="results file; its results are not tried again")
    parser.add_argument("--out", type=Path, help="write the page; needs a whole run")
    options = parser.parse_args(None if arguments is None else list(arguments))
    whole = options.share == 1 and not options.target
    if options.out and not whole:
        parser.error("--out needs a whole run, without --target and --share")
    sys.path.insert(0, str(ROOT))
    preload()
    kept = Kept(options.keep)
    tallies = []
    for target in TARGETS:
        if options.target and target.name not in options.target:
            continue
        begun_s = sum(os.times()[:4])
        try:
            tally = examine(target, kept, share=options.share, offset=options.offset)
        except UnfitError as error:
            print(error, file=sys.stderr)
            return 1
        if options.share != 1:
            tally.stale = []
        tallies.append(tally)
        for mutant in tally.survived:
            print(f"{target.path.relative_to(ROOT)}:{mutant.line}: {mutant.name}")
        for name in tally.stale:
            print(f"  not equivalent, remove it from the list: {name}")
        print(
            f"{target.name:<11}{tally.killed:>5} killed {len(tally.equivalent):>4} equivalent "
            f"{len(tally.survived):>4} survived  {sum(os.times()[:4]) - begun_s:.0f} s of CPU",
            flush=True,
        )
    if options.out:
        options.out.write_text(page(tallies), encoding="utf-8")
    return 1 if any(not tally.passes(whole=options.share == 1) for tally in tallies) else 0


if __name__ == "__main__":
    sys.exit(main())
