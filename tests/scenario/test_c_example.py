"""The example device, built as its page describes: `sweepctl connect` accepts it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from support.c_build import STRICT, any_compiler
from support.core_build import wire
from support.desk_device import check_that_connect_accepts
from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.realtime


def test_connect_accepts_the_example_device(tmp_path: Path) -> None:
    folder = wire(tmp_path)
    program = tmp_path / "device"
    examples = (ROOT / "examples" / name for name in ("device_main.c", "board_pty.c"))
    includes = (f"-I{folder}", f"-I{ROOT / 'examples'}")
    sources = (*examples, folder / "sweepctl_protocol.c")
    any_compiler("gcc", "clang").run(*STRICT, "-Os", *includes, *sources, "-o", program)
    check_that_connect_accepts(program, tmp_path)
