"""The examples on the pages about runs, robots, rooms, plug-ins and Python work as printed."""

from __future__ import annotations

import re
import shlex
import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

import bridge
from support.cli import sweepctl
from support.emulated import Emulated
from support.plugin_site import EXAMPLE, install_example, sweepctl_with
from support.root import ROOT
from tools.virtual.settings import SweeperSettings
from tools.virtual.simulated_sweeper import SimulatedSweeper

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = [pytest.mark.slow, pytest.mark.realtime, pytest.mark.timeout(300)]

PLAN = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 500 400">
<g id="walls"><path d="M 10 10 L 490 10 L 490 390 L 250 390 L 250 300 L 10 300 Z"/></g>
<rect class="furniture" x="100" y="100" width="80" height="50"/>
<ellipse id="rug" cx="380" cy="150" rx="60" ry="40"/>
<circle id="start" cx="60" cy="60" r="3"/>
</svg>"""
MAP = (
    "image: map.pgm\nresolution: 0.05\norigin: [0, -1, 0]\nnegate: 0\n"
    "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
)


@pytest.fixture(name="folder")
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def blocks(page: str, language: str) -> list[str]:
    """Return the code blocks of a language on a page of the documentation."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def commands(page: str) -> list[list[str]]:
    """Return the words after ``sweepctl`` in every command line on a page."""
    lines = "".join(blocks(page, "sh")).splitlines()
    return [shlex.split(line)[1:] for line in lines if line.startswith("sweepctl ")]


def test_the_page_about_runs(folder: Path) -> None:
    found = commands("runs.md")
    assert len(found) == 14
    for words in found:
        done = sweepctl(*words)
        timed = 1 if words[0] == "simulate" else 0  # a simulation ends at its short --max-time
        assert done.status == timed, (words, done.err)
    assert {path.name for path in folder.iterdir()} == {
        *("runs", "planners.html", "missed.html", "newest.html"),
    }
    assert "carpet good" in sweepctl("runs").out


def test_the_page_about_robot_files(folder: Path) -> None:
    found = commands("robot-file.md")
    assert len(found) == 4
    for words in found:
        done = sweepctl(*words)
        assert done.status == 0, (words, done.err)
    assert (folder / "my-robot.png").exists()


def test_the_page_about_rooms(folder: Path) -> None:
    cells = np.zeros((80, 100), dtype=np.uint8)
    cells[5:75, 5:95] = 254
    Image.fromarray(cells).save(folder / "map.pgm")
    (folder / "map.yaml").write_text(MAP)
    (folder / "plan.svg").write_text(PLAN)
    (folder / "study.json").write_text(blocks("rooms.md", "json")[0])
    found = commands("rooms.md")
    assert len(found) == 4
    for words in found:
        done = sweepctl(*words)
        assert done.status == 0, (words, done.err)
    for name in ("flat.json", "plan.json", "study.json"):
        assert sweepctl("room", "check", name).status == 0


def test_the_page_about_plug_ins(tmp_path: Path) -> None:
    site = tmp_path / "site"
    install_example(site)  # instead of pip; a test of the wheel uses pip
    shutil.copy(EXAMPLE / "sweepctl_example" / "planner.py", tmp_path / "my_planner.py")
    found = commands("plugins.md")
    assert len(found) == 3
    for words in found:
        done = sweepctl_with(site, *words)
        assert done.status == 0, (words, done.err)


def test_the_page_about_python(folder: Path) -> None:
    found = blocks("api.md", "python")
    live = [block for block in found if 'bridge.open("' in block]
    virtual = [block for block in found if "with sweeper.record" in block]
    assert (len(live), len(virtual)) == (2, 1)
    with Emulated() as emulated:
        for block in live:
            program = block.replace("/dev/ttyUSB0", emulated.port)
            exec(program, {"bridge": bridge})  # noqa: S102 - the page's own program
            assert (folder / "drive.mcap").stat().st_size > 10_000
            (folder / "drive.mcap").unlink()
    exec(virtual[0], {"sweeper": SimulatedSweeper(SweeperSettings())})  # noqa: S102 - the page's own
    assert (folder / "drive.mcap").stat().st_size > 10_000
