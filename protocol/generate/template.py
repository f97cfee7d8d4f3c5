"""Fills the files of ``templates/``: C, Lua and Markdown with placeholders such as ``@name@``."""

from __future__ import annotations

import re
from importlib.resources import files

_PLACEHOLDER = re.compile("@([a-z_0-9]+)@")


class TemplateError(ValueError):
    """A placeholder without a value, or a value without a placeholder."""


def fill(name: str, **values: object) -> str:
    """Return the text of a template with each placeholder replaced by its value.

    Args:
        name: file name within ``templates/``.
        **values: value of each placeholder; each placeholder must occur in the template.

    Raises:
        TemplateError: placeholders and values do not match.

    """
    text = files("protocol.generate").joinpath("templates", name).read_text(encoding="utf-8")
    wanted = set(_PLACEHOLDER.findall(text))
    if wanted != values.keys():
        odd = ", ".join(sorted(wanted ^ values.keys()))
        raise TemplateError(f"{name}: placeholders and values differ: {odd}")
    return _PLACEHOLDER.sub(lambda match: str(values[match[1]]), text)
