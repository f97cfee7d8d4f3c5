"""Keep the smallest set of fuzzing inputs that reaches the same code as all inputs.

    PYTHONPATH=tests python -m fuzz.keep [TARGET]...

It reads ``corpus/TARGET.txt`` and build/fuzz/TARGET, and rewrites ``corpus/TARGET.txt``.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from fuzz.run import CORPUS, write_corpus
from fuzz.targets import TARGETS
from support.root import ROOT

SIZE_MAX = 600
"""Maximum length of a kept input, bytes. Longer inputs would reach little more code."""


def smallest(target: str, found: Path) -> list[bytes]:
    """Return a small set of inputs that reaches the same code as all inputs."""
    with tempfile.TemporaryDirectory() as into, tempfile.TemporaryDirectory() as everything:
        write_corpus(Path(everything), target)
        for number, path in enumerate(sorted(found.glob("*"))):
            data = path.read_bytes()
            if len(data) <= SIZE_MAX:
                (Path(everything) / f"found-{number}").write_bytes(data)
        subprocess.run(
            [sys.executable, "-m", "fuzz.run", target, "--into", into, "-merge=1", everything],
            env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}"},
            check=True,
        )
        kept = [path.read_bytes() for path in Path(into).iterdir()]
    return sorted(kept, key=lambda data: (len(data), data))


def main() -> None:
    """Write the corpora of the named targets, or of all."""
    for target in sys.argv[1:] or TARGETS:
        lines = [data.hex() + "\n" for data in smallest(target, ROOT / "build" / "fuzz" / target)]
        (CORPUS / f"{target}.txt").write_text("".join(lines), encoding="ascii")


if __name__ == "__main__":
    main()
