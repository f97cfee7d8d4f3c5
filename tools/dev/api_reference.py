"""The reference page of the Python interface, from signatures and docstrings.

``python -m tools.dev.api_reference`` writes ``docs/api.md``.
"""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bridge
from bridge import errors
from bridge.api.recording import Recording
from bridge.api.robot import Robot
from bridge.api.robot_parts import Latest, OwnPlanner
from tools.cli.console import write_line
from tools.virtual.simulated_sweeper import SimulatedSweeper

if TYPE_CHECKING:
    from collections.abc import Iterator

PATH = Path(__file__).parents[2] / "docs" / "api.md"
_HEAD = """# Python interface

How a program opens, reads, drives and records a robot. `python -m tools.dev.api_reference` writes
this page from the docstrings; `help(bridge.open)` and `help(bridge.Robot)` show the same.

```python
import time

import bridge

with bridge.open("/dev/ttyUSB0") as robot, robot.record("drive.mcap"):
    print(robot.imu, robot.range, robot.pose)
    robot.enable()
    for _ in range(20):
        robot.drive(0.1, 0.0)  # repeat it: a velocity expires after half a second
        time.sleep(0.1)
```

The end of the `with` block stops the robot. `robot.stop()` is for danger: it latches the stop, and
the next `enable` needs `clear_stop=True`.

Units are SI: metres, radians, seconds, volts, amperes. Every name ends with its unit. A call with
an argument of the wrong type or range raises an `ArgumentError` before anything is sent.
"""
_CLASSES: tuple[tuple[type, str, str], ...] = (
    (Robot, "Robot", "What `bridge.open` returns."),
    (Latest, "Latest", "What `robot.imu`, `robot.range` and the others return."),
    (OwnPlanner, "Planner of the device", "What `robot.planner` returns."),
    (Recording, "Recording", "What `robot.record` returns."),
    (
        SimulatedSweeper,
        "Virtual sweeper",
        "`tools.virtual.simulated_sweeper.SimulatedSweeper`, and the [fixture](ci.md) `sweeper`.",
    ),
)
_ROLE = re.compile(r":\w+:`~?(?:[\w.]*\.)?(\w+)`")
_SECTION = re.compile(r"^(Args|Returns|Raises|Yields):$")
_NAMES = {"Args": "Arguments", "Returns": "Returns", "Raises": "Raises", "Yields": "Yields"}


def page() -> str:
    """Return the whole page."""
    parts = [_HEAD, "## bridge.open\n", _signature("bridge.open", bridge.open), _text(bridge.open)]
    for kind, title, text in _CLASSES:
        parts += [f"## {title}\n", f"{text} {_first_line(kind)}\n"]
        for name, member in _members(kind):
            if isinstance(member, property):
                parts += [f"### {name}\n", _text(member)]
            else:
                parts += [f"### {name}()\n", _signature(name, member), _text(member)]
    parts += ["## Errors\n", "The errors are in the module `bridge.errors`.\n", _error_table()]
    return "\n".join(parts).rstrip() + "\n"


def documented() -> Iterator[tuple[str, Any]]:
    """Yield each member on the page with its full name."""
    for kind, _, _ in _CLASSES:
        for name, member in _members(kind):
            yield f"{kind.__name__}.{name}", member


def _members(kind: type) -> Iterator[tuple[str, Any]]:
    """Yield the public methods and properties in the order of the source."""
    for name, member in vars(kind).items():
        if not name.startswith("_") and (isinstance(member, property) or callable(member)):
            yield name, member


def _first_line(kind: type) -> str:
    return _plain((inspect.getdoc(kind) or "").split("\n\n")[0])


def _signature(name: str, call: Any) -> str:  # noqa: ANN401 - anything with a signature
    found = inspect.signature(call)
    parameters = [p for p in found.parameters.values() if p.name != "self"]
    short = found.replace(parameters=parameters)
    text = f"{name}{short}"
    if len(text) > _WIDTH:
        star = next((i for i, p in enumerate(parameters) if p.kind is p.KEYWORD_ONLY), None)
        lines = [str(parameter) for parameter in parameters]
        if star is not None:
            lines.insert(star, "*")
        returned = (
            "" if found.return_annotation is found.empty else f" -> {found.return_annotation}"
        )
        inner = "".join(f"    {line},\n" for line in lines)
        text = f"{name}(\n{inner}){returned}"
    text = re.sub(r"<function [^>]*>+ at 0x\w+>", "...", text)
    return f"```python\n{text.replace(chr(39), '')}\n```\n"


_WIDTH = 96
"""Longest signature on one line, characters."""


def _text(documented: object) -> str:
    """Return a docstring as Markdown: sections as lists, literal blocks as code."""
    lines = (inspect.getdoc(documented) or "").splitlines()
    out: list[str] = []
    in_section = in_code = False
    for line in lines:
        head = _SECTION.match(line)
        if in_code and line and not line.startswith(" "):
            out.append("```\n")
            in_code = False
        if head:
            in_section = True
            out += [f"{_NAMES[head[1]]}:", ""]
        elif in_section and line.startswith("    ") and not line.startswith("     "):
            name, colon, rest = line.strip().partition(": ")
            is_entry = colon and re.fullmatch(r"\w+", name)
            out.append(f"- `{name}`: {_plain(rest)}" if is_entry else f"- {_plain(line.strip())}")
        elif in_section and line.startswith("    "):
            out.append(f"  {_plain(line.strip())}")
        elif line.endswith("::"):
            out += [
                _plain(line.removesuffix("::")) + (":" if line != "::" else ""),
                "",
                "```python",
            ]
            in_code = True
        elif in_code:
            if line or out[-1] != "```python":
                out.append(line.removeprefix("    "))
        else:
            in_section = in_section and not line
            out.append(_plain(line))
    if in_code:
        out.append("```")
    return "\n".join(out).replace("\n\n```\n", "\n```\n") + "\n"


def _plain(text: str) -> str:
    return _ROLE.sub(r"`\1`", text).replace("``", "`")


def _error_table() -> str:
    rows = ["| error | exit status | meaning |", "| --- | --- | --- |"]
    for name, kind in vars(errors).items():
        if inspect.isclass(kind) and issubclass(kind, errors.BridgeError):
            base = "" if kind is errors.BridgeError else f" A `{kind.__mro__[1].__name__}`."
            rows.append(f"| `{name}` | {kind.exit_status} | {_first_line(kind)}{base} |")
    return "\n".join(rows) + "\n"


def main() -> None:
    """Write the page."""
    PATH.write_text(page(), "utf-8")
    write_line(f"wrote {PATH}")


if __name__ == "__main__":
    main()
