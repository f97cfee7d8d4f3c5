"""``sweepctl generate``: written files, rejected options, and errors of one line."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from protocol.generate import GENERATORS, render
from tools.cli.main import run

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("name", GENERATORS)
def test_each_writes_its_files_and_names_them(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "folder"
    assert run(["generate", name, "--out", str(out)]) == 0
    written = capsys.readouterr().out.split()
    assert sorted(written) == sorted(str(p) for p in out.iterdir())
    for path in out.iterdir():
        text = path.read_text(encoding="utf-8")
        assert text.endswith("\n")
        assert not any(line != line.rstrip() for line in text.splitlines()), path.name


@pytest.mark.parametrize("name", sorted(set(GENERATORS) - {"md"}))
def test_written_files_equal_the_rendered_text(name: str, tmp_path: Path) -> None:
    assert run(["generate", name, "--out", str(tmp_path)]) == 0
    assert {p.name: p.read_text(encoding="utf-8") for p in tmp_path.iterdir()} == render(name)


def test_nothing_is_replaced_unless_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "sweepctl.proto"
    mine.write_text("mine", encoding="utf-8")
    assert run(["generate", "proto", "--out", str(tmp_path)]) == 1
    assert mine.read_text(encoding="utf-8") == "mine"
    assert capsys.readouterr().err.splitlines() == [
        f"sweepctl: {mine} exists; give another name, or --force to replace it"
    ]
    assert run(["generate", "proto", "--out", str(tmp_path), "--force"]) == 0
    assert mine.read_text(encoding="utf-8") != "mine"


def test_a_folder_that_cannot_be_made(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    target = tmp_path / "file" / "inside"
    assert run(["generate", "proto", "--out", str(target)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"sweepctl: cannot write {target}")


@pytest.mark.parametrize(
    "arguments",
    [
        ["generate", "cobol", "--out", "x"],
        ["generate", "c"],
        ["generate", "md", "--out", "x", "--node", "2"],
        ["generate", "dbc", "--out", "x", "--node", "16"],
    ],
)
def test_wrong_usage(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("sweepctl: ")
    assert line.endswith("(see sweepctl generate --help)")


def test_dbc_of_another_node(tmp_path: Path) -> None:
    assert run(["generate", "dbc", "--out", str(tmp_path), "--node", "3"]) == 0
    assert {p.name: p.read_text(encoding="utf-8") for p in tmp_path.iterdir()} == render(
        "dbc", node=3
    )
