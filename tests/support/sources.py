"""Loads the ordinary compiled modules from their sources, for coverage and fuzzing.

    python -m pytest -p support.sources --cov

An import of this module is enough. The numerical kernels stay compiled, because they are too slow
in Python.
"""

from __future__ import annotations

import sys
from importlib.abc import MetaPathFinder
from importlib.util import spec_from_file_location
from typing import TYPE_CHECKING

from tools.dev import kernels

if TYPE_CHECKING:
    from collections.abc import Sequence
    from importlib.machinery import ModuleSpec
    from types import ModuleType


class SourceFinder(MetaPathFinder):
    """Finds the source of each module that has its types in a .pxd."""

    def __init__(self) -> None:
        typed = (source for source in kernels.sources() if kernels.types(source).exists())
        self._paths = {kernels.module_name(source): source for source in typed}

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find a module as :meth:`importlib.abc.MetaPathFinder.find_spec` does."""
        del path, target
        source = self._paths.get(fullname)
        return spec_from_file_location(fullname, source) if source else None


sys.meta_path.insert(0, SourceFinder())
