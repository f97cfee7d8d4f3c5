"""Every command that reads logs, on malicious files, with limited memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
from mcap.reader import make_reader

from bridge.record.info import describe
from bridge.record.reader import LogReader
from support.hostile_logs import GOOD, GROUPS, attachment_of

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow
DOCUMENTED = {0, 1, 2, 3, 4}


SAMPLE = 1
"""Number of files of each group in `make test`; `make nightly` uses all files."""


@pytest.mark.timeout(600)
@pytest.mark.parametrize("group", GROUPS)
@pytest.mark.parametrize("files", [SAMPLE, pytest.param(100, marks=pytest.mark.nightly, id="all")])
def test_no_log_fills_the_memory_or_ends_in_a_traceback(
    group: str, files: int, tmp_path: Path
) -> None:
    """``info`` and ``recover`` still save the valid message."""
    environment = {**os.environ, "PYTHONPATH": "tests:.", "OPENBLAS_NUM_THREADS": "1"}
    ended = subprocess.run(
        [sys.executable, "-m", "support.limited", group, str(tmp_path), str(files)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr[-2000:]
    done = json.loads(ended.stdout)
    for what, reported in done.items():
        assert reported["status"] in DOCUMENTED, f"{what}: {reported}"
        assert "Traceback" not in reported["said"], f"{what}: {reported}"
    recovered = sorted(tmp_path.glob("*-recover.mcap"))
    assert len(recovered) == sum(what.endswith(": recover") for what in done)
    assert len(recovered) == files if files == SAMPLE else len(recovered) > 2
    for out in recovered:
        with out.open("rb") as file:
            messages = make_reader(file, validate_crcs=True).iter_messages(["/good"])
            assert next(messages)[2].data == GOOD, out.name
    for what, reported in done.items():
        if what.endswith((": info", ": recover")):
            assert reported["status"] == 0, f"{what}: {reported}"


def test_a_large_attachment_is_named_and_not_held(tmp_path: Path) -> None:
    path = tmp_path / "large.mcap"
    path.write_bytes(attachment_of(65 << 20))
    reader = LogReader(path)
    assert reader.attachments == {}
    assert reader.attachment_bytes.keys() == {"huge.bin"}
    assert "attachment huge.bin not read" in reader.problems[0]
    assert describe(path).attachments["huge.bin"] > 65 << 20
    assert [m.data for m in reader.messages()] == [GOOD]
