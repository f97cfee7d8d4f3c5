"""The instructions of docs/extending.md, executed exactly on a copy of the source."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from protocol.messages.host import TimeRequest
from support import reference_codec as ref
from support.cli import plain_messages
from support.random_scripts import Writer
from support.root import ROOT
from support.script_format import read, script

DUST = 0x3A
LOCKED = Path(sys.executable).parent
"""Folder with the CMake of the lock file."""
PAGE = ROOT / "docs" / "extending.md"
COPIED = ("protocol", "bridge", "sim_device", "tools", "docs/protocol")
_EDIT = re.compile(
    r"^In `(?P<file>[^`]+)`, (?P<how>before|after|replace) `(?P<anchor>[^`]+)`:\n\n"
    r"```(?:python|c)\n(?P<code>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
_RUN = re.compile(r"^```sh\n(?P<lines>.*?)^```$", re.MULTILINE | re.DOTALL)


class Edit(NamedTuple):
    """A change of one file."""

    file: str
    how: str
    anchor: str
    code: str

    def make(self, tree: Path) -> None:
        path = tree / self.file
        text = path.read_text(encoding="utf-8")
        assert text.count(f"{self.anchor}\n") == 1, f"{self.file}: {self.anchor!r}"
        line = f"{self.anchor}\n"
        new = {
            "before": self.code + line,
            "after": line + self.code,
            "replace": self.code,
        }[self.how]
        path.write_text(text.replace(line, new), encoding="utf-8")


def steps(text: str) -> list[Edit | str]:
    """Return the page's instructions in order: edits of files, and shell commands."""
    found: list[tuple[int, Edit | str]] = [
        (m.start(), Edit(m["file"], m["how"], m["anchor"], m["code"])) for m in _EDIT.finditer(text)
    ]
    for block in _RUN.finditer(text):
        found += [(block.start(), line) for line in block["lines"].splitlines()]
    return [step for _, step in sorted(found, key=lambda item: item[0])]


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for folder in COPIED:
        ignored = shutil.ignore_patterns("build", "*.mcap")
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=ignored)
    return tmp_path


def run(line: str, tree: Path) -> str:
    program, *words = shlex.split(line)
    assert program in {"python", "make"}
    done = subprocess.run(
        [sys.executable if program == "python" else program, *words],
        cwd=tree,
        env={**os.environ, "PYTHONPATH": str(tree), "PATH": f"{LOCKED}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode in {0, 1}, done.stderr  # 1: --max-time ended the run
    assert "Traceback" not in done.stderr, done.stderr
    return done.stdout + done.stderr


def dust_of_the_core(program: Path, seconds: int) -> list[tuple[int, bytes]]:
    """Run the firmware for some seconds; return stamp (µs) and payload of each dust message."""
    writer = Writer()
    writer.begin()
    for _ in range(seconds):
        writer.wait(900_000)
        writer.inform(TimeRequest(1), after_us=100_000)
    done = subprocess.run([program], input=script(writer.acts), capture_output=True, check=True)
    wrote = b"".join(step.wrote for step in read(done.stdout))
    frames = [f for f in ref.parse_stream(wrote) if isinstance(f, ref.RefFrame)]
    return [(f.t_us, f.payload) for f in frames if f.type_id == DUST]


@pytest.mark.needs("gcc")
def test_the_page_can_be_followed(tree: Path) -> None:
    printed = []
    for step in steps(PAGE.read_text(encoding="utf-8")):
        if isinstance(step, Edit):
            step.make(tree)
        else:
            printed.append(run(step, tree))
    assert printed[0].strip() == "[]", "the catalogue's lint has nothing to say"
    assert "/device/dust" in printed[2], "it is in the log"
    messages = plain_messages(tree / "dust.mcap", "/device/dust")
    # 2 Hz during the drive of 4 s and the 2.5 s of rest before it
    assert len(messages) == pytest.approx(2 * 6.5, abs=2)
    core = dust_of_the_core(tree / "sim_device" / "firmware" / "build" / "script_host", 10)
    assert len(core) == pytest.approx(2 * 10, abs=1)
    for t_us, payload in core:
        particles = t_us // 50_000
        assert payload == particles.to_bytes(2, "little") + b"\xc8\0" + bytes((particles // 1000,))
    assert "dust" in next((tree / "firmware").glob("*.dbc")).read_text().lower()
    assert "dust" in next((tree / "firmware").glob("*.lua")).read_text().lower()
    assert "`dust`" in (tree / "docs" / "protocol" / "PROTOCOL.md").read_text()


def test_the_page_explains_its_figures() -> None:
    found = steps(PAGE.read_text(encoding="utf-8"))
    assert sum(isinstance(step, Edit) for step in found) == 3
    assert sum(isinstance(step, str) for step in found) == 8
