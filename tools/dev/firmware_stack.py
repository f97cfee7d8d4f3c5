"""Maximum stack use of the firmware, from the compiler's data on each function.

GCC writes a call graph with each function's own frame (``-fcallgraph-info=su``). Functions of the C
library are read from the disassembly: the bytes that their instructions push and reserve.
Interrupts are added, one for each priority level. The size of an interrupt includes the frame that
the processor itself pushes (PM0214, section 2.3.7: 26 words with the floating point registers, and
one word for alignment).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

FRAME_BYTES = 27 * 4
_NODE = re.compile(r'^node: \{ title: "([^"]+)" label: "([^"]*)"')
_EDGE = re.compile(r'^edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
_OWN = re.compile(r"\\n(\d+) bytes \((\w+)")
_SYMBOL = re.compile(r"^[0-9a-f]+ <([^>]+)>:$")
_PUSH = re.compile(r"\t(v?push|stmdb)\S*\s+(?:sp!, )?\{([^}]*)\}")
_ONE = re.compile(r"\tstr\S*\s+\w+, \[sp, #-(\d+)\]!")
_RESERVE = re.compile(r"\tsub\S*\s+sp, (?:sp, )?#(\d+)")
_CALL = re.compile(r"\tbl?(?:\.[nw])?\s+[0-9a-f]+ <([^>+]+)>")
INDIRECT = "__indirect_call"


class UnboundedStackError(Exception):
    """The stack has no bound; the text names the function that causes this."""


@dataclass(slots=True)
class Calls:
    """The call graph, and the size of each function's own frame, bytes."""

    own: dict[str, int] = field(default_factory=dict)
    calls: dict[str, set[str]] = field(default_factory=dict)

    def read_graph(self, text: str) -> None:
        """Read the call graph of one translation unit.

        Raises:
            UnboundedStackError: a function's frame has no fixed size.

        """
        for line in text.splitlines():
            if node := _NODE.match(line):
                if own := _OWN.search(node[2]):
                    if own[2] != "static":
                        raise UnboundedStackError(f"{node[1]} has a frame of {own[2]} size")
                    self.own[node[1]] = int(own[1])
            elif edge := _EDGE.match(line):
                self.calls.setdefault(edge[1], set()).add(edge[2])

    def read_disassembly(self, lines: Iterable[str]) -> None:
        """Read the output of ``objdump -d`` for functions that no call graph contains."""
        name: str | None = None
        for line in lines:
            if symbol := _SYMBOL.match(line):
                name = None if symbol[1] in self.own else symbol[1]
                if name is not None:
                    self.own[name] = 0
                    self.calls.setdefault(name, set())
            elif name is not None:
                self.own[name] += _taken(line)
                call = _CALL.search(line)
                if call and call[1] != name:
                    self.calls[name].add(call[1])

    def deepest(self, root: str) -> tuple[int, list[str]]:
        """Return the bytes of the deepest chain of calls from a function, and the chain.

        Raises:
            UnboundedStackError: a function of the chain calls itself, an unknown function, or a
                function by its pointer.

        """
        return self._deepest(root, [], {})

    def _deepest(
        self, name: str, above: list[str], known: dict[str, tuple[int, list[str]]]
    ) -> tuple[int, list[str]]:
        if name in above:
            raise UnboundedStackError(f"{name} calls itself, by {' > '.join(above)}")
        if name == INDIRECT:
            raise UnboundedStackError(f"{above[-1]} calls through a pointer")
        if name not in self.own:
            raise UnboundedStackError(f"nothing is known of {name}, called by {above[-1:]}")
        if name not in known:
            below: tuple[int, list[str]] = 0, []
            for callee in sorted(self.calls.get(name, ())):
                below = max(below, self._deepest(callee, [*above, name], known))
            known[name] = self.own[name] + below[0], [name, *below[1]]
        return known[name]


def _taken(line: str) -> int:
    """Return the number of bytes that one instruction takes from the stack."""
    if push := _PUSH.search(line):
        size = 8 if push[1] == "vpush" and "d" in push[2] else 4
        return size * sum(_count(part) for part in push[2].split(","))
    if one := _ONE.search(line):
        return int(one[1])
    reserve = _RESERVE.search(line)
    return int(reserve[1]) if reserve else 0


def _count(part: str) -> int:
    """Return the number of registers in ``r4``, ``r4-r8`` or ``d8-d9``."""
    first, _, last = part.strip().partition("-")
    return int(last[1:]) - int(first[1:]) + 1 if last else 1


def bound(calls: Calls, root: str, levels: Mapping[int, Sequence[str]]) -> int:
    """Return the maximum stack use of the program and one interrupt per level, bytes."""
    total, _ = calls.deepest(root)
    for handlers in levels.values():
        total += FRAME_BYTES + max(calls.deepest(handler)[0] for handler in handlers)
    return total
