"""Coverage-guided fuzzing of one target with atheris.

    PYTHONPATH=tests python -m fuzz.run parser -runs=20000 -seed=1

What follows the target are libFuzzer's options; ``-max_total_time=60`` searches for a minute.
An input that breaks something is written to the working directory, and the exit status is
not 0.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["protocol"]):
    from fuzz.targets import TARGETS
    from protocol.can_link import CanLink
    from protocol.catalogue import CATALOGUE
    from protocol.link import Link


def write_corpus(folder: Path) -> None:
    """One intact frame of every message, for UART and for CAN, each after a cutting byte."""
    for spec in CATALOGUE:
        values = [
            "a" if f.wire.is_text else bytes(12) if not f.wire.is_integer else 1
            for f in spec.fields
        ]
        message = spec.cls(*values)
        for medium, end in (("uart", Link(spec.direction)), ("can", CanLink(spec.direction))):
            end.send(message, 1000, node=1)
            (folder / f"{medium}-{spec.name}").write_bytes(b"\x1f" + end.data_to_send())
        payload = Link(spec.direction).codec.encode(message)[1]
        index = CATALOGUE.specs.index(spec)
        (folder / f"payload-{spec.name}").write_bytes(bytes([index]) + payload)


def main() -> None:
    """Fuzz the target named first with libFuzzer's options after it."""
    name, *options = sys.argv[1:] or [""]
    if name not in TARGETS:
        sys.exit(f"usage: python -m fuzz.run {{{'|'.join(TARGETS)}}} [libFuzzer option]...")
    with tempfile.TemporaryDirectory() as corpus:
        write_corpus(Path(corpus))
        atheris.Setup([sys.argv[0], corpus, "-max_len=2048", *options], TARGETS[name])
        atheris.Fuzz()


if __name__ == "__main__":
    main()
