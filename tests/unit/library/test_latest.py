"""The names of the newest run and of the runs before it."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.library.errors import LibraryError, NoRunError
from bridge.library.library import resolve
from support.small_logs import write_log


def test_latest_is_the_newest_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    runs = tmp_path / "runs"
    other = tmp_path / "other"
    runs.mkdir()
    other.mkdir()
    for number in range(3):
        write_log(runs / f"{9 - number}.mcap", at_s=number)
    write_log(runs / "truth.mcap", at_s=100, port="emulated")
    write_log(other / "x.mcap")
    assert resolve(Path("latest")) == Path("runs/7.mcap")
    assert resolve(Path("latest~2")) == Path("runs/9.mcap")
    assert resolve(Path("other/latest")) == Path("other/x.mcap")
    assert resolve(Path("other/x.mcap")) == Path("other/x.mcap")
    assert resolve(Path("latest.mcap")) == Path("latest.mcap")
    with pytest.raises(NoRunError, match="no run latest~3 in runs: it has 3 runs"):
        resolve(Path("latest~3"))
    with pytest.raises(LibraryError, match="cannot read the folder none"):
        resolve(Path("none/latest"))
    (tmp_path / "latest").write_bytes(b"a file of this name is itself")
    assert resolve(Path("latest")) == Path("latest")
