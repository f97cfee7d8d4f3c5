"""The reference page of a planner's interface, from the fields and their docstrings.

``python -m tools.dev.planner_reference`` writes ``docs/planner-interface.md``.
"""

from __future__ import annotations

import ast
import inspect
import sys
from enum import Enum
from pathlib import Path
from typing import NamedTuple

from bridge.coverage.planner import Finish, PlannerEvent, PlannerState
from bridge.motion.geometry import Pose2
from bridge.motion.legs import Drive, Dwell, FollowWall, GoTo, LegResult, StopReason, Turn
from bridge.motion.observation import Observation
from tools.cli.console import write_line

ROOT = Path(__file__).parents[2]
PATH = ROOT / "docs" / "planner-interface.md"
_EXAMPLE = ROOT / "examples" / "plugin" / "sweepctl_example" / "planner.py"
_HEAD = """# Interface of a planner

What a planner of your own gets and returns. `python -m tools.dev.planner_reference` writes this
page from the source. [Plug-ins](plugins.md#planners) explains how sweepctl finds your planner, and
[control](control.md) how a leg is driven.

A planner is called once at the start, and then at the end of each leg. It returns a leg, or
`Finish`. The simplest planner is a `ScriptedPlanner`: its method `script` yields legs, and receives
the result of each leg and the newest observation:

```python
"""
_PARTS: tuple[tuple[str, tuple[type, ...]], ...] = (
    ("Legs", (Drive, Turn, GoTo, FollowWall, Dwell)),
    ("Result of a leg", (LegResult, StopReason)),
    ("Observation", (Observation, Pose2)),
    ("What a planner reports", (Finish, PlannerState, PlannerEvent)),
)


class _Field(NamedTuple):
    name: str
    kind: str
    default: str
    text: str


def page() -> str:
    """Return the whole page."""
    parts = [f"{_HEAD}{_example()}```\n"]
    for title, kinds in _PARTS:
        parts.append(f"## {title}\n")
        for kind in kinds:
            parts += [f"### {kind.__name__}\n", f"{_plain(inspect.getdoc(kind) or '')}\n"]
            fields = _fields(kind)
            if issubclass(kind, Enum):
                rows = ["| member | meaning |", "| --- | --- |"]
                rows += [f"| `{field.name}` | {field.text} |" for field in fields]
            else:
                rows = ["| field | type | default | meaning |", "| --- | --- | --- | --- |"]
                rows += [
                    f"| `{name}` | {_code(kind_of)} | {_code(default)} | {text} |"
                    for name, kind_of, default, text in fields
                ]
            parts.append("\n".join(rows) + "\n")
    return "\n".join(parts)


def _fields(kind: type) -> list[_Field]:
    """Return the fields of a class, or the members of an enumeration, with their docstrings."""
    tree = ast.parse(inspect.getsource(sys.modules[kind.__module__]))
    (found,) = (
        node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == kind.__name__
    )
    fields: list[_Field] = []
    for node in found.body:
        match node:
            case ast.AnnAssign(target=ast.Name(id=name), annotation=kind_of, value=value):
                default = "" if value is None else ast.unparse(value)
                default = "{}" if "default_factory=dict" in default else default
                fields.append(_Field(name, ast.unparse(kind_of), default, ""))
            case ast.Assign(targets=[ast.Name(id=name)]):
                fields.append(_Field(name, "", "", ""))
            case ast.Expr(value=ast.Constant(value=str(text))) if fields:
                fields[-1] = fields[-1]._replace(text=_plain(text).replace("\n", " "))
            case _:
                pass
    return fields


def _code(text: str) -> str:
    return f"`{text}`".replace("|", "\\|") if text else ""


def _plain(text: str) -> str:
    return " ".join(text.replace("``", "`").split())


def _example() -> str:
    """Return the class of the example planner."""
    text = _EXAMPLE.read_text("utf-8")
    return text[text.index("class FixedTurnPlanner") : text.index("\n\ndef make")].rstrip() + "\n"


def main() -> None:
    """Write the page."""
    PATH.write_text(page(), "utf-8")
    write_line(f"wrote {PATH}")


if __name__ == "__main__":
    main()
