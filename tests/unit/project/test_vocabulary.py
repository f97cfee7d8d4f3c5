"""The vocabulary check finds retired words in all kinds of identifiers; the project has none."""

from __future__ import annotations

import tomllib
from typing import TYPE_CHECKING

import pytest

from tools.dev import vocabulary

if TYPE_CHECKING:
    from pathlib import Path

WORDS = {"doubt": "uncertainty", "set aside": "abandoned", "most_": "max_", "told": "reported"}


@pytest.mark.parametrize(
    ("source", "name"),
    [
        ("def doubt_of(): ...", "doubt_of"),
        ("async def is_told(): ...", "is_told"),
        ("class DoubtfulDoubt: ...", "DoubtfulDoubt"),
        ("def f(told): ...", "told"),
        ("def f(*, told=1): ...", "told"),
        ("most_turns = 3", "most_turns"),
        ("self.set_aside = 1", "set_aside"),
        ("for doubt in (): ...", "doubt"),
        ("with f() as doubt: ...", "doubt"),
        ("if (doubt := 1): ...", "doubt"),
        ("import a as told", "told"),
        ("try: ...\nexcept E as doubt: ...", "doubt"),
        ("match x:\n    case [*told]: ...", "told"),
        ("match x:\n    case told: ...", "told"),
        ("SET_ASIDE_M: float = 1.0", "SET_ASIDE_M"),
    ],
)
def test_a_retired_word_is_found_in_each_kind_of_name(source: str, name: str) -> None:
    found = [
        n.text for n in vocabulary.defined_names(source) if vocabulary.retired_in(n.text, WORDS)
    ]
    assert found == [name]


@pytest.mark.parametrize(
    "name", ["undoubted", "at_most", "most", "set_for_aside", "aside_set", "x"]
)
def test_only_whole_words_in_their_order_are_retired(name: str) -> None:
    assert vocabulary.retired_in(name, WORDS) == []


def test_names_of_c_code_without_comments_and_texts() -> None:
    source = '/* told\n told */ int doubt; // told\nputs("told \\" told"); doubt = kept;\n'
    assert list(vocabulary.c_names(source)) == [(2, "int"), (2, "doubt"), (3, "puts"), (3, "kept")]


def test_a_hit_names_place_word_and_replacement(tmp_path: Path) -> None:
    for name in vocabulary.FILES:
        (tmp_path / name).write_text("")
    (tmp_path / "bridge").mkdir()
    (tmp_path / "bridge" / "told.py").write_text("\ndoubt = 1\nkept_doubt = 2\n")
    (tmp_path / "bridge" / "state.h").write_text("typedef int told_t;\n")
    hits, unused = vocabulary.check(tmp_path, WORDS, {"kept_doubt", "old_doubt"})
    assert [str(hit) for hit in hits] == [
        "bridge/state.h:1: told_t: 'told' is retired; use reported",
        "bridge/told.py:1: told: 'told' is retired; use reported",
        "bridge/told.py:2: doubt: 'doubt' is retired; use uncertainty",
    ]
    assert unused == {"old_doubt"}


def test_the_project_uses_no_retired_word(capsys: pytest.CaptureFixture[str]) -> None:
    assert vocabulary.main() == 0, capsys.readouterr().out


def test_each_retired_word_has_a_replacement() -> None:
    glossary = (vocabulary.ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    words = vocabulary.retired_words(glossary)
    assert {"doubt", "told", "set aside", "most_", "outline", "dice"} <= set(words)
    assert all(words.values())


def test_each_exception_has_a_reason() -> None:
    table = tomllib.loads((vocabulary.ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert all(table["tool"]["sweepctl"]["vocabulary"]["allowed"].values())
