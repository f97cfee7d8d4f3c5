"""The pages about the paper list every option with its default, and every layout."""

from __future__ import annotations

import re
from dataclasses import fields

from bridge.coverage.baselines.paper import PaperOptions
from support.root import ROOT
from tools.rooms.layouts import LAYOUTS

DOCS = ROOT / "docs"


def reported(page: str) -> dict[str, str]:
    """Return the first two cells of every table row whose first cell is code."""
    rows = re.findall(
        r"^\| `([\w-]+)` \| ([^|]+) \|", (DOCS / page).read_text("utf-8"), re.MULTILINE
    )
    return {name: cell.strip("`") for name, cell in rows}


def test_every_option_with_its_default() -> None:
    defaults = {
        field.name: f'"{field.default}"' if isinstance(field.default, str) else str(field.default)
        for field in fields(PaperOptions)
    }
    assert {name: reported("paper-options.md").get(name) for name in defaults} == defaults


def test_every_layout() -> None:
    assert set(LAYOUTS) <= set(reported("paper-layouts.md"))
