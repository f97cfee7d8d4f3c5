"""Coverage-guided fuzzing of one target with atheris.

    PYTHONPATH=tests python -m fuzz.run parser -runs=20000 -seed=1

libFuzzer's options follow the target; ``-max_total_time=60`` searches for a minute. An input that
fails is written to the working directory, and the exit status is not 0.

A search begins with the kept inputs of earlier searches in ``corpus/TARGET.txt``, one hexadecimal
input a line. Inputs that reach new code are added to build/fuzz/TARGET (``--into FOLDER`` names
another folder). ``python -m fuzz.keep`` then writes the smallest set of inputs that reaches the
same code into ``corpus``.
"""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

import atheris

import support.sources  # noqa: F401 - only bytecode can be instrumented
from support.root import ROOT

with atheris.instrument_imports(include=["protocol"]):
    from fuzz.targets import TARGETS
    from protocol.can.link import CanLink
    from protocol.schema.catalogue import CATALOGUE
    from protocol.uart.link import Link


CORPUS = Path(__file__).parent / "corpus"


def write_corpus(folder: Path, target: str) -> None:
    """Write initial inputs: the kept inputs of earlier searches, and inputs from the catalogue.

    The catalogue gives one intact frame of every message, for UART and for CAN, after the byte that
    determines the split into reads. It also gives one payload of every message.
    """
    for number, data in enumerate(kept(target)):
        (folder / f"kept-{number}").write_bytes(data)
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


def kept(target: str) -> list[bytes]:
    """Return the inputs of ``corpus/TARGET.txt``."""
    path = CORPUS / f"{target}.txt"
    return [bytes.fromhex(line) for line in path.read_text(encoding="ascii").splitlines()]


def main() -> None:
    """Fuzz the first named target with libFuzzer's options after it."""
    name, *options = sys.argv[1:] or [""]
    if name not in TARGETS:
        targets = "|".join(TARGETS)
        sys.exit(f"usage: python -m fuzz.run {{{targets}}} [--into FOLDER] [libFuzzer option]...")
    folder = ROOT / "build" / "fuzz" / name
    if options[:1] == ["--into"]:
        folder, options = Path(options[1]), options[2:]
    folder.mkdir(parents=True, exist_ok=True)
    if not any(option.startswith("-merge") for option in options):
        write_corpus(folder, name)
    # libFuzzer restarts itself through a shell, with the words before its options.
    again = shlex.join([sys.executable, "-m", "fuzz.run", name, "--into", str(folder)])
    atheris.Setup([again, str(folder), "-max_len=2048", *options], TARGETS[name])
    atheris.Fuzz()


if __name__ == "__main__":
    main()
