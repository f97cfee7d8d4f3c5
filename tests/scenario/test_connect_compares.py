"""Checks at the start of ``connect``: other parameters on the device, a robot at another place."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

import pytest

from support.two_processes import Command, Emulator

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.realtime


def test_a_connect_names_other_values_and_another_place(tmp_path: Path) -> None:
    wide = tmp_path / "wide.toml"
    wide.write_text("wheel_base_m = 0.25\n")
    with Emulator(tmp_path, "--robot", wide) as device:
        arguments = ("--room", "studio-flat", "--json", "--out", "elsewhere.mcap")
        with Command("connect", device.port, *arguments, cwd=tmp_path) as host:
            host.prints("wheel_base: the device has 0.25 m, the host's default robot has 0.23 m")
            host.prints("the robot does not seem to be at the start of studio-flat")
            host.send(signal.SIGINT)
            ended = host.end()
        assert ended.status == 0
        assert ended.json["path_m"] is None, "nothing moved"
        here = ("--room", "case-1", "--robot", wide, "--duration", "3", "--json")
        with Command("connect", device.port, *here, cwd=tmp_path) as host:
            ended = host.end()
        assert ended.status == 0
        assert "the device has" not in ended.err
        assert "does not seem" not in ended.err
