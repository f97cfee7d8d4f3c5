"""A user's firmware library in a separate process."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import pytest

from sim_device.core.chip import FirmwareCrashError, FirmwareLibraryError, LocalChip
from sim_device.core.core_sweeper import CoreSweeper
from sim_device.ports import core_process
from sim_device.ports.core_process import CoreProcess
from support.core_build import LIBRARY, library
from support.rigs import OPEN_FLOOR, Drive, rig
from support.root import ROOT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from sim_device.core.chip import Chip

pytestmark = pytest.mark.slow

CRASHING = (LIBRARY[0], ROOT / "tests" / "c" / "crashing_firmware.c")


@pytest.fixture
def made() -> Iterator[Callable[..., CoreSweeper]]:
    """Return a function that creates devices; their processes end after the test."""
    devices = []

    def make(path: Path, kind: Callable[..., Chip] = CoreProcess) -> CoreSweeper:
        make_chip = partial(kind, library=path)
        devices.append(CoreSweeper(OPEN_FLOOR, noise="none", seed=1, make_chip=make_chip))
        return devices[-1]

    yield make
    for device in devices:
        device.close()


def test_the_same_library_lives_the_same_life_in_both_processes(
    made: Callable[..., CoreSweeper],
) -> None:
    lives = []
    for kind in (CoreProcess, LocalChip):
        drive = Drive(rig(device=made(library(*LIBRARY), kind)), 0.2, 0.5)
        drive.run(4.0)
        lives.append(drive.bytes)
    assert lives[0] == lives[1]
    assert len(lives[0]) > 300


@pytest.mark.needs("addr2line")
@pytest.mark.parametrize(
    ("bug", "what", "where"),
    [
        ("pointer", "crashed: SIGSEGV in follow_the_pointer", "follow_the_pointer at crashing"),
        ("assert", "too late", "poll at crashing"),
        ("loop", "does not return within", "poll at crashing"),
        ("exit", "called exit(7)", None),
    ],
)
def test_a_crash_is_reported_with_its_backtrace(
    made: Callable[..., CoreSweeper],
    monkeypatch: pytest.MonkeyPatch,
    bug: str,
    what: str,
    where: str | None,
) -> None:
    monkeypatch.setenv("BUG", bug)
    monkeypatch.setattr(core_process, "PATIENCE_S", 2.0)
    drive = Drive(rig(device=made(library(*CRASHING))), 0.2)
    with pytest.raises(FirmwareCrashError) as caught:
        drive.run(5.0)
    assert drive.now_us == 2_000_000
    assert what in str(caught.value)
    if where is not None:
        assert any(line.startswith(where) for line in caught.value.trace), caught.value.trace


@pytest.mark.needs("gcc")
def test_a_sanitizer_ends_it_with_its_report(
    made: Callable[..., CoreSweeper], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BUG", "heap")
    drive = Drive(rig(device=made(library(*CRASHING, sanitized=True))), 0.2)
    with pytest.raises(FirmwareCrashError) as caught:
        drive.run(5.0)
    assert drive.now_us == 2_000_000
    assert "write_behind" in caught.value.details
    assert "crashed: " in str(caught.value)


@pytest.mark.parametrize("kind", [CoreProcess, LocalChip])
@pytest.mark.parametrize(
    ("bug", "reason"), [("version", "another version"), ("sizes", "sizes"), ("imu", "MPU6050")]
)
def test_a_library_of_another_abi_is_rejected(
    made: Callable[..., CoreSweeper],
    monkeypatch: pytest.MonkeyPatch,
    kind: Callable[..., Chip],
    bug: str,
    reason: str,
) -> None:
    monkeypatch.setenv("BUG", bug)
    with pytest.raises(FirmwareLibraryError, match=reason):
        made(library(*CRASHING), kind)


def test_a_file_that_is_no_library_is_rejected(
    made: Callable[..., CoreSweeper], tmp_path: Path
) -> None:
    other = tmp_path / "text.so"
    other.write_text("no library")
    with pytest.raises(FirmwareLibraryError, match=r"text\.so"):
        made(other)
