"""Mutants of a module: each with one small change that a test should notice.

Changed are comparisons, arithmetic, conditions, constants, the choice of a larger or smaller,
and whole statements; left alone are texts, annotations, docstrings, and what a target's
exclusions name. A mutant is named by where it is and what it changes, not by its line, so that
the list of equivalent ones outlives edits elsewhere in the file.
"""

from __future__ import annotations

import ast
import copy
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

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
_SWAPPED = {"min": "max", "max": "min"}


@dataclass(frozen=True)
class Mutant:
    """One change."""

    where: str
    """Class and function, dotted; empty at the module's level."""
    before: str
    after: str
    number: int
    """Among equal changes of one place, from 0."""
    line: int
    source: str
    """The whole module with the change."""

    @property
    def name(self) -> str:
        """What the list of equivalents knows it by."""
        nth = f" #{self.number}" if self.number else ""
        return f"{self.where or 'module'}: {self.before} -> {self.after}{nth}"


def mutants(source: str, exclude: frozenset[str] = frozenset()) -> list[Mutant]:
    """Every mutant of a module; ``exclude`` are functions and classes, dotted or by last name."""
    tree = ast.parse(source)
    seen: Counter[tuple[str, str, str]] = Counter()
    found = []
    for path, where, replacement in _changes(tree, exclude):
        changed = copy.deepcopy(tree)
        holder, original = _locate(changed, path)
        before = ast.unparse(original)
        line = getattr(original, "lineno", 0)
        _put(holder, path[-1], replacement)
        after = ast.unparse(replacement)
        key = where, before, after
        text = ast.unparse(ast.fix_missing_locations(changed))
        found.append(Mutant(where, before, after, seen[key], line, text))
        seen[key] += 1
    return found


Step = tuple[str, int | None]
Path = tuple[Step, ...]


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
    for name, value in ast.iter_fields(node):
        if name in {"annotation", "returns", "decorator_list", "args", "bases", "type_params"}:
            if not (name == "args" and isinstance(node, ast.Call)):
                continue
        if isinstance(value, ast.AST):
            yield from _walk(value, (*path, (name, None)), where, exclude)
        elif isinstance(value, list):
            for index, item in enumerate(value):
                if isinstance(item, ast.AST):
                    yield from _walk(item, (*path, (name, index)), where, exclude)


def _left_alone(node: ast.AST) -> bool:
    """Texts, imports, docstrings, and what only a type checker sees."""
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
    match node:
        case ast.Compare(ops=ops):
            for index, op in enumerate(ops):
                for other in _COMPARE.get(type(op), ()):
                    changed = copy.deepcopy(node)
                    changed.ops[index] = other()
                    yield changed
        case ast.BinOp(op=op) if type(op) in _ARITHMETIC:
            changed_op = copy.deepcopy(node)
            changed_op.op = _ARITHMETIC[type(op)]()
            yield changed_op
        case ast.AugAssign(op=op) if type(op) in _ARITHMETIC:
            changed_assign = copy.deepcopy(node)
            changed_assign.op = _ARITHMETIC[type(op)]()
            yield changed_assign
            yield ast.Pass()
        case ast.BoolOp(op=op, values=values):
            changed_bool = copy.deepcopy(node)
            changed_bool.op = ast.Or() if isinstance(op, ast.And) else ast.And()
            yield changed_bool
            for value in values:
                if not isinstance(value, ast.BoolOp):
                    yield value
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield operand
        case ast.Constant(value=bool() as flag):
            yield ast.Constant(value=not flag)
        case ast.Constant(value=int() | float() as number):
            yield ast.Constant(value=number + 1)
            if number not in {0, 1}:
                yield ast.Constant(value=type(number)(number / 2))
        case ast.Call(func=ast.Name(id=name)) if name in _SWAPPED:
            changed_call = copy.deepcopy(node)
            changed_call.func = ast.Name(id=_SWAPPED[name], ctx=ast.Load())
            yield changed_call
        case ast.IfExp(body=body, orelse=orelse):
            yield body
            yield orelse
        case ast.Assign() | ast.Expr() | ast.Raise() | ast.Delete() | ast.Continue() | ast.Break():
            yield ast.Pass()
        case ast.AnnAssign(target=ast.Attribute() as target) if node.value is not None:
            if not (isinstance(node.value, ast.Constant) and node.value.value is None):
                yield ast.Assign(
                    targets=[target], value=ast.Constant(value=None), lineno=node.lineno
                )
        case ast.Return(value=value) if value is not None:
            if not (isinstance(value, ast.Constant) and value.value is None):
                yield ast.Return(value=ast.Constant(value=None))
        case _:
            return


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
