"""A fixed part of the fuzzing campaign; ``make campaign`` runs more inputs."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from fuzz.targets import TARGETS, held_bytes
from protocol.uart.framing import UartParser
from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

RUNS = {"parser": 15_000, "link": 2_500, "codec": 25_000, "batch": 1_500, "can": 6_000}
SHARE = 5
"""``make test`` divides the number of inputs by this number."""


@pytest.mark.parametrize("share", [SHARE, pytest.param(1, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("decoder", list(TARGETS))
def test_no_input_that_the_fuzzer_finds_breaks_it(decoder: str, share: int, tmp_path: Path) -> None:
    runs = RUNS[decoder] // share
    # -reload=0: libFuzzer would otherwise reread the corpus each second, and the inputs would
    # depend on the machine.
    options = [f"-runs={runs}", "-seed=1", "-reload=0", f"-artifact_prefix={tmp_path}/"]
    done = fuzz(decoder, tmp_path / "found", *options)
    assert done.returncode == 0, done.stderr[-3000:]
    assert f"Done {runs} runs" in done.stderr


def fuzz(decoder: str, into: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "fuzz.run", decoder, "--into", str(into), *options]
    paths = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}"}
    return subprocess.run(
        command, cwd=into.parent, env=paths, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("decoder", list(TARGETS))
def test_the_fuzzing_corpus_passes(decoder: str) -> None:
    inputs = corpus(decoder)
    assert len(inputs) > 5
    assert len(set(inputs)) == len(inputs)
    for data in inputs:
        TARGETS[decoder](data)


def corpus(decoder: str) -> list[bytes]:
    path = ROOT / "tests" / "fuzz" / "corpus" / f"{decoder}.txt"
    return [bytes.fromhex(line) for line in path.read_text(encoding="ascii").splitlines()]


def test_a_search_starts_from_the_corpus_and_adds_its_findings(tmp_path: Path) -> None:
    found = tmp_path / "found"
    done = fuzz("can", found, "-runs=3000", "-seed=3", "-reload=0")
    assert done.returncode == 0, done.stderr[-3000:]
    inputs = [path.read_bytes() for path in found.iterdir()]
    assert set(corpus("can")) <= set(inputs)
    seeds = len([path for path in found.iterdir() if path.name.startswith(("kept-", "uart-"))])
    assert len(inputs) > seeds > len(corpus("can"))


def test_the_kept_corpus_reaches_as_much_with_fewer_inputs(tmp_path: Path) -> None:
    """Inputs that reach no new code, and long inputs, are not kept."""
    for number in range(100):
        (tmp_path / f"same-{number}").write_bytes(b"\x1f" + bytes(number))
    (tmp_path / "long").write_bytes(bytes(100_000))
    script = (
        "from fuzz.keep import smallest; from pathlib import Path; import sys; "
        "print(*[d.hex() or '-' for d in smallest('can', Path(sys.argv[1]))], sep='\\n')"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)],
        env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}"},
        capture_output=True,
        text=True,
        check=True,
    )
    kept = [bytes.fromhex(line.strip("-")) for line in done.stdout.splitlines()]
    assert 20 < len(kept) < len(corpus("can")) + 50
    assert kept == sorted(kept, key=lambda data: (len(data), data))
    assert max(map(len, kept)) <= 600


def test_a_reader_that_kept_everything_would_be_found_out() -> None:
    class Hoarder(UartParser):
        def __init__(self) -> None:
            super().__init__()
            self.kept = bytes(300_000)

    assert held_bytes(Hoarder()) > held_bytes(UartParser()) + 290_000
