"""docs/paper.md names every choice that the paper leaves open, with its default."""

from __future__ import annotations

import re
from dataclasses import fields

from bridge.coverage.baselines.paper import PaperOptions
from support.root import ROOT
from tools.experiment.layouts import LAYOUTS

PAGE = ROOT / "docs" / "paper.md"


def reported() -> dict[str, str]:
    """First and second cell of every line of a table whose first is code."""
    rows = re.findall(r"^\| `([\w-]+)` \| ([^|]+) \|", PAGE.read_text("utf-8"), re.MULTILINE)
    return {name: cell.strip("`") for name, cell in rows}


def test_every_option_with_its_default() -> None:
    defaults = {
        field.name: f'"{field.default}"' if isinstance(field.default, str) else str(field.default)
        for field in fields(PaperOptions)
    }
    assert {name: reported().get(name) for name in defaults} == defaults


def test_every_layout() -> None:
    assert set(LAYOUTS) <= set(reported())
