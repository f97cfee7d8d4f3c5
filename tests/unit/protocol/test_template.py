"""Templates are filled completely, or not at all."""

from __future__ import annotations

from importlib.resources import files

import pytest

from protocol.generate.template import TemplateError, fill

NAMES = sorted(f.name for f in files("protocol.generate").joinpath("templates").iterdir())


def test_every_language_that_people_read_has_a_template() -> None:
    assert {name.rsplit(".", 1)[1] for name in NAMES} == {"c", "h", "lua", "md"}


@pytest.mark.parametrize("name", NAMES)
def test_a_placeholder_without_a_value_is_named(name: str) -> None:
    with pytest.raises(TemplateError, match=rf"^{name}: placeholders and values differ: "):
        fill(name)


def test_a_value_without_a_placeholder_is_named() -> None:
    with pytest.raises(TemplateError, match=r"PROTOCOL-timing\.md: .*differ: other$"):
        fill("PROTOCOL-timing.md", rules="", other=1)


def test_values_replace_their_placeholders() -> None:
    text = fill("PROTOCOL-timing.md", rules="| a |")
    assert text.endswith("| a |")
    assert "@" not in text
