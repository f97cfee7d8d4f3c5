"""Plug-ins in a live run: the dashboard shows their messages and the state of their planner."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

import pytest

from support.plugin_site import install_example
from support.root import ROOT
from support.terminal import OnTerminal
from support.two_processes import Emulator

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.realtime


def test_the_dashboard_shows_messages_and_planner_of_plug_ins(tmp_path: Path) -> None:
    install_example(tmp_path / "site")
    path = f"{tmp_path / 'site'}:{ROOT}"
    run = ("--plan", "fixed-turn", "--out", tmp_path / "run.mcap")
    with (
        Emulator(tmp_path, PYTHONPATH=path) as device,
        OnTerminal("connect", device.port, *run, cwd=tmp_path, PYTHONPATH=path) as terminal,
    ):
        for text in ("plug-ins", "dust", "particles", "20 Hz", "fixed-turn", "drive"):
            terminal.shows(text)
        terminal.process.send_signal(signal.SIGINT)
        assert terminal.end() == 0
