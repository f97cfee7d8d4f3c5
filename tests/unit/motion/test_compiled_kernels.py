"""Kernels: what goes in and comes out, what does not fit, and the code that is kept."""

from __future__ import annotations

import errno
import importlib
import importlib.util
import os
import stat
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bridge.motion.compiled import (
    KERNELS,
    KernelArgumentError,
    compiled,
    compiled_unlocked,
    keep,
    kept,
)
from bridge.motion.kernel_call import layout_is_known
from support.root import ROOT

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from numpy.typing import NDArray

pytestmark = pytest.mark.slow

SOURCE = """
from bridge.motion.compiled import compiled

@compiled
def scaled(values: "Floats", by: float) -> float:
    total = 0.0
    for k in range(values.shape[0]):
        values[k] *= by
        total += values[k]
    return total
"""


@compiled
def _half(value: float) -> float:
    return 0.5 * value


@compiled
def looked_at(grid: Any, marks: Any, at: int, share: float, up: bool) -> tuple[int, float, bool]:  # noqa: ANN401, FBT001
    count = 0
    for row in range(grid.shape[0]):
        for column in range(grid.shape[1]):
            if grid[row, column] > share:
                count += 1
                marks[row] = 7
    return count * 10 + at, _half(grid[0, 0]), not up


@compiled
def filled(marks: Any, value: int) -> None:  # noqa: ANN401
    for k in range(marks.shape[0]):
        marks[k] = value


@compiled_unlocked
def spun(times: int, value: int) -> int:
    for _ in range(times):
        value ^= value << 13
        value ^= value >> 7
    return value


@compiled
def allocating(count: int) -> float:
    return float(np.zeros(count)[0])


def grid() -> NDArray[np.float64]:
    return np.array([[3.0, 1.0], [0.0, 5.0], [0.0, 0.0]])


def test_numbers_and_arrays_go_in_and_a_tuple_comes_out() -> None:
    marks = np.zeros(3, dtype=np.int32)
    assert looked_at(grid(), marks, 4, 2.0, True) == (24, 1.5, False)  # noqa: FBT003
    assert marks.tolist() == [7, 7, 0]
    assert [type(v) for v in looked_at(grid(), marks, 4, 2.0, False)] == [int, float, bool]  # noqa: FBT003


def test_other_threads_go_on_while_an_unlocked_kernel_runs() -> None:
    spun(1, 1)
    span: list[float] = []
    met: list[float] = []

    def work() -> None:
        span.append(time.perf_counter())
        spun(200_000_000, 1)
        span.append(time.perf_counter())

    thread = threading.Thread(target=work)
    thread.start()
    while thread.is_alive():
        met.append(time.perf_counter())
        time.sleep(0.001)
    begin, end = span
    tenth = 0.1 * (end - begin)
    assert any(begin + tenth < at < end - tenth for at in met)


def test_nothing_comes_out_of_nothing() -> None:
    marks = np.zeros(2, dtype=np.uint8)
    assert filled(marks, 9) is None
    assert marks.tolist() == [9, 9]


def test_numbers_of_numpy_are_numbers() -> None:
    marks = np.zeros(3, dtype=np.int32)
    numbers: tuple[Any, ...] = np.int64(4), np.float32(2.0), np.True_
    got = looked_at(grid(), marks, *numbers)
    assert got == (24, 1.5, False)


@pytest.mark.parametrize(
    "wrong",
    [
        np.zeros((3, 2), dtype=np.float32),
        np.zeros(3),
        np.zeros((2, 3)).T,
        np.zeros((3, 4))[:, :2],
    ],
    ids=["dtype", "dimensions", "order", "gaps"],
)
def test_another_array_is_refused_by_what_it_is(wrong: NDArray[Any]) -> None:
    marks = np.zeros(3, dtype=np.int32)
    looked_at(grid(), marks, 4, 2.0, True)  # noqa: FBT003
    with pytest.raises(KernelArgumentError, match=r"looked_at is compiled for \(f8:2, i4:1"):
        looked_at(wrong, marks, 4, 2.0, True)  # noqa: FBT003
    assert marks.tolist() == [7, 7, 0]


def test_what_is_no_number_raises_as_python_does() -> None:
    marks = np.zeros(3, dtype=np.int32)
    with pytest.raises(TypeError, match="real number"):
        looked_at(grid(), marks, 4, "much", True)  # type: ignore[arg-type]  # noqa: FBT003
    with pytest.raises(OverflowError):
        looked_at(grid(), marks, 1 << 70, 2.0, True)  # noqa: FBT003


def test_a_kernel_that_allocates_says_so() -> None:
    from bridge.motion.kernel_build import KernelError  # noqa: PLC0415 - numba takes long

    with pytest.raises(KernelError, match=r"allocating allocates"):
        allocating(3)


def test_references_are_counted_right() -> None:
    marks, table = np.zeros(3, dtype=np.int32), grid()
    bytes_ = np.zeros(2, dtype=np.uint8)
    looked_at(table, marks, 4, 2.0, True)  # noqa: FBT003
    before = sys.getrefcount(marks), sys.getrefcount(table), sys.getrefcount(None)
    for _ in range(1000):
        looked_at(table, marks, 4, 2.0, True)  # noqa: FBT003
        filled(bytes_, 9)
    after = sys.getrefcount(marks), sys.getrefcount(table), sys.getrefcount(None)
    assert after[:2] == before[:2]
    assert abs(after[2] - before[2]) < 100


def module_of(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_full_disk_is_left_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_self: Path, _target: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        keep(b"code", [tmp_path / "a" / "x.kernel", tmp_path / "b" / "x.kernel"])
    assert [p.name for p in tmp_path.rglob("*") if p.is_file()] == []


def test_code_is_kept_until_its_file_changes(tmp_path: Path) -> None:
    path = tmp_path / "kept_kernel.py"
    values = np.array([1.0, 2.0])

    def fresh() -> tuple[Callable[..., float], bool]:
        scaled = module_of(path).scaled
        scaled(values.copy(), 1.0)
        return scaled, KERNELS[scaled].was_built

    path.write_text(SOURCE)
    assert fresh()[1] is True
    assert fresh()[1] is False
    assert len(list((tmp_path / "__pycache__").glob("*.kernel"))) == 1
    path.write_text(SOURCE.replace("*= by", "*= 2.0 * by"))
    scaled, was_built = fresh()
    assert was_built
    assert scaled(values.copy(), 1.0) == 6.0


def test_damaged_code_is_not_taken(tmp_path: Path) -> None:
    path = tmp_path / "x.kernel"
    code = bytes(range(64))
    keep(code, [path])
    assert kept(path, set()) == code
    whole = path.read_bytes()
    for end in range(len(whole)):
        path.write_bytes(whole[:end])
        assert kept(path, set()) is None, f"cut after {end} B"
    for at in range(len(whole)):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        assert kept(path, set()) is None, f"a flip in byte {at}"
    for content in (whole + b"\0", bytes(len(whole)), whole * 2):
        path.write_bytes(content)
        assert kept(path, set()) is None
    path.write_bytes(whole)
    assert kept(path.rename(tmp_path / "y.kernel"), set()) is None, "of another kernel"
    assert kept(tmp_path, set()) is None, "a folder"
    assert kept(path / "nothing", set()) is None


def test_a_kernel_whose_code_was_cut_is_compiled_again(tmp_path: Path) -> None:
    path = tmp_path / "damaged_kernel.py"
    path.write_text(SOURCE)

    def built() -> bool:
        scaled = module_of(path).scaled
        assert scaled(np.array([1.0, 2.0]), 2.0) == 6.0
        return KERNELS[scaled].was_built

    assert built()
    (file,) = (tmp_path / "__pycache__").glob("*.kernel")
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert built()
    assert not built()


def test_others_may_read_kept_code_and_code_that_they_may_write_is_not_run(tmp_path: Path) -> None:
    path = tmp_path / "x.kernel"
    keep(b"code", [path])
    assert stat.S_IMODE(path.stat().st_mode) == 0o644
    for mode in (0o666, 0o664, 0o646):
        path.chmod(mode)
        assert kept(path, {path.stat().st_uid}) is None, oct(mode)


def test_code_of_a_stranger_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "x.kernel"
    keep(b"code", [path])
    owner = path.stat().st_uid
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    assert kept(path, set()) is None
    assert kept(path, {owner}) == b"code", "who installed the package"


def test_what_cannot_be_read_or_kept_is_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "unkept_kernel.py"
    path.write_text(SOURCE)
    (tmp_path / "__pycache__").write_text("a file where the folder belongs")
    monkeypatch.setenv("XDG_CACHE_HOME", str(path / "below a file"))
    scaled = module_of(path).scaled
    assert scaled(np.array([1.0, 2.0]), 2.0) == 6.0
    assert KERNELS[scaled].was_built


def test_code_is_not_kept_beyond_a_number_from_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    numbers, path = tmp_path / "kernel_numbers.py", tmp_path / "numbered_kernel.py"
    path.write_text(
        "import kernel_numbers\n" + SOURCE.replace("*= by", "*= kernel_numbers.GAIN * by")
    )

    def answer(gain: float) -> float:
        numbers.write_text(f"GAIN = {gain}\n")
        sys.modules.pop("kernel_numbers", None)
        importlib.invalidate_caches()
        result: float = module_of(path).scaled(np.array([1.0, 2.0]), 1.0)
        return result

    assert answer(2.0) == 6.0
    assert answer(30.0) == 90.0


def test_a_short_run_needs_no_compiler() -> None:
    """Numba takes a second to import: it is there for what is not compiled yet only."""
    program = (
        "import sys; from tools.dev.warm import warm; warm(); sys.modules.pop('numba', None);"
        "import subprocess as s; print(s.run([sys.executable, '-c', "
        "'import sys; from tools.dev.warm import warm; warm(); print(\"numba\" in sys.modules)'],"
        "capture_output=True, text=True, check=True).stdout)"
    )
    root = ROOT
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=root, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "False"


def test_this_python_is_one_that_kernels_are_called_from_directly() -> None:
    assert layout_is_known()
