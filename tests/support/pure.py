"""A kernel as its source says it, run by Python: what the compiled module must agree with."""

from __future__ import annotations

import importlib.util
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType


def load_pure(source: Path) -> ModuleType:
    """Load a module from its source, whether it is compiled or not; under a name of its own."""
    spec = importlib.util.spec_from_file_location(
        f"{source.parent.name}_{source.stem}_pure", source
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look there
    spec.loader.exec_module(module)
    return module
