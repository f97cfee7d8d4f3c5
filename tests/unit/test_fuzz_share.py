"""A fixed share of the fuzzing; more of it is ``make campaign``."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from fuzz.targets import TARGETS, held_bytes
from protocol.uart import UartParser

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
RUNS = {"parser": 15_000, "link": 2_500, "codec": 25_000, "batch": 1_500, "can": 6_000}


@pytest.mark.parametrize("target", list(TARGETS))
def test_no_input_that_the_fuzzer_finds_breaks_it(target: str, tmp_path: Path) -> None:
    # reading the corpus again, every second, would run more, and others on each machine
    options = [f"-runs={RUNS[target]}", "-seed=1", "-reload=0", f"-artifact_prefix={tmp_path}/"]
    command = [sys.executable, "-m", "fuzz.run", target, *options]
    paths = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}"}
    done = subprocess.run(
        command, cwd=tmp_path, env=paths, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert f"Done {RUNS[target]} runs" in done.stderr


def test_a_reader_that_kept_everything_would_be_found_out() -> None:
    parser = UartParser()
    before = held_bytes(parser)
    parser._partial = bytes(300_000)  # noqa: SLF001 - the fault to be found
    assert held_bytes(parser) > before + 290_000
