"""Mutants of a module: each with one small change that a test should detect.

Changes affect comparisons, arithmetic, conditions, constants, min and max, and whole statements.
Texts, annotations, docstrings and a target's exclusions stay unchanged. A mutant's name consists of
its place and its change, not its line. So the list of equivalent mutants stays valid when other
parts of the file change.
"""

from __future__ import annotations

import ast
import copy
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_COMPARE: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Mod: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.RShift: ast.LShift,
    ast.LShift: ast.RShift,
    ast.Pow: ast.Mult,
}
_DECLARING = frozenset({"annotation", "returns", "decorator_list", "bases", "type_params"})
_SWAPPED = {"min": "max", "max": "min"}


Step = tuple[str, int | None]
Path = tuple[Step, ...]
"""Path from the module to one of its nodes."""


@dataclass(frozen=True)
class Mutant:
    """One change."""

    where: str
    """Class and function, dotted; empty at the module's level."""
    before: str
    after: str
    number: int
    """Number among equal changes in one place, from 0."""
    line: int
    tree: ast.Module = field(compare=False, repr=False)
    """Tree of the unchanged module."""
    path: Path = field(compare=False, repr=False)
    replacement: ast.AST = field(compare=False, repr=False)

    @property
    def changed(self) -> ast.Module:
        """Return the whole module with the change, on unchanged lines."""
        changed = copy.deepcopy(self.tree)
        holder, original = _locate(changed, self.path)
        replacement = ast.copy_location(copy.deepcopy(self.replacement), original)
        _put(holder, self.path[-1], replacement)
        return ast.fix_missing_locations(changed)

    @property
    def source(self) -> str:
        """Return the whole module with the change, as text."""
        return ast.unparse(self.changed)

    @property
    def lines(self) -> range:
        """Lines of the changed statement or of its head; if it runs, one of these lines runs."""
        node: ast.AST = self.tree
        first = last = 0
        for step in self.path:
            node = _get(node, step)
            if isinstance(node, ast.stmt | ast.ExceptHandler | ast.match_case):
                first = getattr(node, "lineno", first)
                body = getattr(node, "body", None)
                end = getattr(node, "end_lineno", None) or first
                last = max(first, body[0].lineno - 1) if body else end
        return range(first, last + 1)

    @property
    def name(self) -> str:
        """Name in the list of equivalents."""
        nth = f" #{self.number}" if self.number else ""
        return f"{self.where or 'module'}: {self.before} -> {self.after}{nth}"


def mutants(source: str, exclude: frozenset[str] = frozenset()) -> list[Mutant]:
    """Return every mutant of a module.

    ``exclude`` names functions and classes, by dotted name or by last name.
    """
    tree = ast.parse(source)
    seen: Counter[tuple[str, str, str]] = Counter()
    found = []
    for path, where, replacement in _changes(tree, exclude):
        _, original = _locate(tree, path)
        before, after = ast.unparse(original), ast.unparse(replacement)
        line = getattr(original, "lineno", 0)
        key = where, before, after
        found.append(Mutant(where, before, after, seen[key], line, tree, path, replacement))
        seen[key] += 1
    return found


def _changes(tree: ast.Module, exclude: frozenset[str]) -> Iterator[tuple[Path, str, ast.AST]]:
    yield from _walk(tree, (), "", exclude)


def _walk(
    node: ast.AST, path: Path, where: str, exclude: frozenset[str]
) -> Iterator[tuple[Path, str, ast.AST]]:
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        where = f"{where}.{node.name}" if where else node.name
        if where in exclude or node.name in exclude:
            return
    if _left_alone(node):
        return
    if path:
        for replacement in _mutations(node):
            yield path, where, replacement
    for name, index, child in _children(node):
        yield from _walk(child, (*path, (name, index)), where, exclude)


def _children(node: ast.AST) -> Iterator[tuple[str, int | None, ast.AST]]:
    """Yield the child nodes that are executed, with their places in the node."""
    for name, value in ast.iter_fields(node):
        if name in _DECLARING or (name == "args" and not isinstance(node, ast.Call)):
            continue
        if isinstance(value, ast.AST):
            yield name, None, value
        elif isinstance(value, list):
            yield from (
                (name, i, item) for i, item in enumerate(value) if isinstance(item, ast.AST)
            )


def _left_alone(node: ast.AST) -> bool:
    """Return whether a node stays unchanged: texts, imports, docstrings, type checking."""
    if isinstance(node, ast.JoinedStr | ast.Import | ast.ImportFrom | ast.Assert):
        return True
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return True
    if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
        return True
    if isinstance(node, ast.Assign):
        return ast.unparse(node.targets[0]) in {"__slots__", "__all__", "Evidence"}
    return isinstance(node, ast.AnnAssign) and node.value is None


def _mutations(node: ast.AST) -> Iterator[ast.AST]:
    kind = type(node)
    if kind in _OF:
        yield from _OF[kind](node)


def _compare(node: Any) -> Iterator[ast.AST]:
    for index, op in enumerate(node.ops):
        for other in _COMPARE.get(type(op), ()):
            changed = copy.deepcopy(node)
            changed.ops[index] = other()
            yield changed


def _arithmetic(node: Any) -> Iterator[ast.AST]:
    other = _ARITHMETIC.get(type(node.op))
    if other is not None:
        changed = copy.deepcopy(node)
        changed.op = other()
        yield changed
    if isinstance(node, ast.AugAssign):
        yield ast.Pass()


def _boolean(node: Any) -> Iterator[ast.AST]:
    changed = copy.deepcopy(node)
    changed.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
    yield changed
    yield from (value for value in node.values if not isinstance(value, ast.BoolOp))


def _unary(node: Any) -> Iterator[ast.AST]:
    if isinstance(node.op, ast.Not | ast.USub):
        yield node.operand


def _constant(node: Any) -> Iterator[ast.AST]:
    value = node.value
    if isinstance(value, bool):
        yield ast.Constant(value=not value)
    elif isinstance(value, int | float):
        yield ast.Constant(value=value + 1)
        if value not in {0, 1}:
            yield ast.Constant(value=type(value)(value / 2))


def _call(node: Any) -> Iterator[ast.AST]:
    name = getattr(node.func, "id", "")
    if name in _SWAPPED:
        changed = copy.deepcopy(node)
        changed.func = ast.Name(id=_SWAPPED[name], ctx=ast.Load())
        yield changed


def _choice(node: Any) -> Iterator[ast.AST]:
    yield node.body
    yield node.orelse


def _nothing(_node: Any) -> Iterator[ast.AST]:
    yield ast.Pass()


def _is_none(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def _declared(node: Any) -> Iterator[ast.AST]:
    if isinstance(node.target, ast.Attribute) and not _is_none(node.value):
        none = ast.Constant(value=None)
        yield ast.Assign(targets=[node.target], value=none, lineno=node.lineno)


def _returned(node: Any) -> Iterator[ast.AST]:
    if node.value is not None and not _is_none(node.value):
        yield ast.Return(value=ast.Constant(value=None))


_OF: dict[type[ast.AST], Callable[[Any], Iterator[ast.AST]]] = {
    ast.Compare: _compare,
    ast.BinOp: _arithmetic,
    ast.AugAssign: _arithmetic,
    ast.BoolOp: _boolean,
    ast.UnaryOp: _unary,
    ast.Constant: _constant,
    ast.Call: _call,
    ast.IfExp: _choice,
    ast.AnnAssign: _declared,
    ast.Return: _returned,
    **dict.fromkeys((ast.Assign, ast.Expr, ast.Raise, ast.Continue, ast.Break), _nothing),
}


def _locate(tree: ast.AST, path: Path) -> tuple[ast.AST, ast.AST]:
    holder = tree
    for step in path[:-1]:
        holder = _get(holder, step)
    return holder, _get(holder, path[-1])


def _get(node: ast.AST, step: Step) -> ast.AST:
    name, index = step
    value = getattr(node, name)
    found = value if index is None else value[index]
    assert isinstance(found, ast.AST)
    return found


def _put(node: ast.AST, step: Step, replacement: ast.AST) -> None:
    name, index = step
    if index is None:
        setattr(node, name, replacement)
    else:
        getattr(node, name)[index] = replacement
