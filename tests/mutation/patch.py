"""Puts a mutant into a process: the code of one function, or a whole new module."""

from __future__ import annotations

import ast
import importlib.abc
import importlib.util
import sys
from collections import defaultdict
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import TYPE_CHECKING, Any

from support.root import ROOT

if TYPE_CHECKING:
    from collections.abc import Sequence
    from importlib.machinery import ModuleSpec

    from mutation.mutator import Mutant


def function_of(module: ModuleType, mutant: Mutant) -> FunctionType | None:
    """Return the plain function whose code a mutant changes, or None if there is none."""
    owner: Any = module
    node: ast.AST = mutant.tree
    for name, index in mutant.path:
        value = getattr(node, name)
        node = value if index is None else value[index]
        if isinstance(node, ast.ClassDef):
            owner = vars(owner)[node.name]
        elif isinstance(node, ast.FunctionDef):
            found = vars(owner)[node.name]
            if isinstance(found, property):
                found = found.fget
            elif isinstance(found, staticmethod | classmethod):
                found = found.__func__
            plain = isinstance(found, FunctionType) and found.__code__.co_name == node.name
            return found if plain else None
    return None


def put_code(function: FunctionType, mutant: Mutant, path: Path) -> None:
    """Give a function the mutant's code."""
    original = function.__code__
    for code in _codes(compile(mutant.changed, str(path), "exec")):
        if code.co_qualname == original.co_qualname and code.co_firstlineno in {
            original.co_firstlineno,
            function.__code__.co_firstlineno,
        }:
            function.__code__ = code
            return
    raise LookupError(f"no {original.co_qualname} in the mutant")


def _codes(code: CodeType) -> list[CodeType]:
    found = [code]
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            found += _codes(constant)
    return found


class Instead(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Loads one module from a mutant's code."""

    def __init__(self, module: str, path: Path, mutant: Mutant) -> None:
        self._module, self._path, self._mutant = module, path, mutant

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        del path, target
        if fullname != self._module:
            return None
        return importlib.util.spec_from_loader(fullname, self, origin=str(self._path))

    def exec_module(self, module: ModuleType) -> None:
        code = compile(self._mutant.changed, str(self._path), "exec")
        exec(code, module.__dict__)  # noqa: S102 - our own source


def forget(names: set[str]) -> None:
    """Drop modules, so that they are imported again."""
    for name in names:
        loaded = sys.modules.pop(name, None)
        holder, _, last = name.rpartition(".")
        above = sys.modules.get(holder)
        if loaded is not None and above is not None and getattr(above, last, None) is loaded:
            delattr(above, last)


def importers(module: str) -> set[str]:
    """Return a module, and all our loaded modules that import it, directly or indirectly."""
    by: defaultdict[str, set[str]] = defaultdict(set)
    for name, loaded in list(sys.modules.items()):
        file = getattr(loaded, "__file__", None)
        if file is None or ROOT not in Path(file).parents or not file.endswith(".py"):
            continue
        for node in ast.walk(ast.parse(Path(file).read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    by[alias.name].add(name)
            elif isinstance(node, ast.ImportFrom) and node.module:
                by[node.module].add(name)
                for alias in node.names:
                    by[f"{node.module}.{alias.name}"].add(name)
    found, waiting = {module}, [module]
    while waiting:
        for name in by[waiting.pop()] - found:
            found.add(name)
            waiting.append(name)
    return found
