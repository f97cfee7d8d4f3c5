"""Kernels as Python modules from their source, as the reference for the compiled modules."""

from __future__ import annotations

import importlib.util
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType


def load_pure(source: Path) -> ModuleType:
    """Load a module from its Python source under its usual name, whether it is compiled or not."""
    spec = importlib.util.spec_from_file_location(
        f"{source.parent.name}_{source.stem}_pure", source
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses searches for the module here
    spec.loader.exec_module(module)
    return module
