"""In every text for users, a unit follows a number."""

from __future__ import annotations

import ast
import re
from typing import TYPE_CHECKING

from support.root import ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator

MODULES = sorted(
    path
    for folder in ("bridge", "sim_device")
    for path in (ROOT / folder).rglob("*.py")
    if "view" not in path.parts  # axes and columns have a unit after a comma or in brackets
)
_UNIT = re.compile(r"(?<![\w.])(m/s²?|rad/s|°/s|mm|cm|ms|Hz|ppm|%|°)(?![\w%{])")
_NUMBER = re.compile(r"([\d{}][})]?|\()\s?$")
"""Valid text before a unit: a digit, an inserted value, or a bracket."""


def texts(source: str) -> Iterator[str]:
    """Yield every string of a module except docstrings, with ``{}`` for each inserted value."""
    tree = ast.parse(source)
    passed = set[int]()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            passed.add(id(node.value))
        if isinstance(node, ast.JoinedStr):
            passed.update(id(part) for part in ast.walk(node) if part is not node)
    for node in ast.walk(tree):
        if id(node) in passed:
            continue
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield re.sub(r"\{[^{}]*\}", "{}", node.value)
        elif isinstance(node, ast.JoinedStr):
            parts = (p.value if isinstance(p, ast.Constant) else "{}" for p in node.values)
            yield "".join(map(str, parts))


def bare_units(source: str) -> list[str]:
    """Return the texts in which a unit does not follow a number."""
    return [
        text
        for text in texts(source)
        if " " in text and any(not _NUMBER.search(text[: m.start()]) for m in _UNIT.finditer(text))
    ]


def test_every_unit_in_a_text_has_its_number() -> None:
    assert len(MODULES) > 100
    bare = {str(path): bare_units(path.read_text(encoding="utf-8")) for path in MODULES}
    assert {path: found for path, found in bare.items() if found} == {}


def test_a_unit_without_a_number_is_found() -> None:
    assert bare_units('TEXT = "it bumped into something, m/s lost at once"')
    assert bare_units("def f(x): return f'{x} is lost, in % of all'")
    assert not bare_units('TEXT = "it lost {:.3f} m/s at once, 5 % of its speed"')
    assert not bare_units("def f(x): return f'moved by {x:.1f} mm (5 mm) in 3 ms'")
    assert not bare_units('def f():\n    """Speed in m/s and % of all."""')
