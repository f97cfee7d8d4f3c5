"""Texts generated from the catalogue, for other languages, tools and people.

Each generator is a module with a pure function ``render``. The function returns the generated texts
by file name. A generator is imported only when it is used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from protocol.schema.catalogue import CATALOGUE, Catalogue

if TYPE_CHECKING:
    from collections.abc import Callable


def _lazily(module: str) -> Callable[..., dict[str, str]]:
    def render(catalogue: Catalogue = CATALOGUE, **options: Any) -> dict[str, str]:  # noqa: ANN401 - its options
        files: dict[str, str] = importlib.import_module(module).render(catalogue, **options)
        return files

    return render


GENERATORS: dict[str, Callable[..., dict[str, str]]] = {
    name: _lazily(f"protocol.generate.{name}") for name in ("c", "dbc", "lua", "proto", "md")
}
"""Generators by their name in ``sweepctl generate``."""

PER_NODE = frozenset({"dbc"})
"""Names of the generators whose output is for one device. They have the option ``node``."""


def render(
    name: str,
    catalogue: Catalogue = CATALOGUE,
    node: int = 1,
    **options: Any,  # noqa: ANN401 - options of the generator
) -> dict[str, str]:
    """Return the texts of one generator by file name; ``options`` depend on the generator.

    Raises:
        KeyError: there is no generator with this name.

    """
    if name in PER_NODE:
        options["node"] = node
    return GENERATORS[name](catalogue, **options)
