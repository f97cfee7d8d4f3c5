"""The maximum stack size of small call graphs and listings, calculated by hand."""

from __future__ import annotations

import pytest

from tools.dev.firmware_stack import Calls, UnboundedStackError, bound


def node(title: str, size: str) -> str:
    return f'node: {{ title: "{title}" label: "{title}\\nx.c:1:1\\n{size}" }}\n'


def edge(caller: str, callee: str) -> str:
    return f'edge: {{ sourcename: "{caller}" targetname: "{callee}" label: "x.c:1:1" }}\n'


def calls(text: str, listing: str = "") -> Calls:
    made = Calls()
    made.read_graph(text)
    made.read_disassembly(listing.splitlines())
    return made


GRAPH = (
    node("main", "16 bytes (static)")
    + node("short", "200 bytes (static)")
    + node("long", "8 bytes (static)")
    + node("leaf", "100 bytes (static)")
    + node("tick", "24 bytes (static)")
    + edge("main", "short")
    + edge("main", "long")
    + edge("long", "leaf")
    + edge("long", "copy")
    + 'node: { title: "copy" label: "copy\\n<built-in>" shape : ellipse }\n'
)
LISTING = """
08000100 <copy>:
 8000100:\tb5f0      \tpush\t{r4, r5, r6, r7, lr}
 8000102:\t4800      \tstmdb\tsp!, {r8-r11}
 8000104:\te92d      \tvpush\t{d8-d9}
 8000106:\tf84d 4d04 \tstr.w\tr4, [sp, #-8]!
 8000108:\tb0c8      \tsub\tsp, #288\t; 0x120
 800010a:\tf7ff      \tbl\t8000200 <inner>
 800010c:\te7fe      \tb.n\t8000106 <copy+0x6>
08000200 <inner>:
 8000200:\tb082      \tsub\tsp, sp, #4
 8000202:\t4770      \tbx\tlr
"""


def test_the_deepest_chain_not_the_largest_frame() -> None:
    copied = 5 * 4 + 4 * 4 + 2 * 8 + 8 + 288
    size, chain = calls(GRAPH, LISTING).deepest("main")
    assert size == 16 + 8 + copied + 4
    assert chain == ["main", "long", "copy", "inner"]


def test_each_interrupt_level_adds_to_the_stack() -> None:
    text = GRAPH.replace(edge("long", "copy"), "") + node("other", "40 bytes (static)")
    made = calls(text)
    assert made.deepest("main") == (216, ["main", "short"])
    # Each level adds its largest interrupt and the processor's frame of 27 words.
    assert bound(made, "main", {4: ("tick", "other"), 8: ("leaf",)}) == 216 + 108 + 40 + 108 + 100


@pytest.mark.parametrize(
    ("more", "why"),
    [
        (edge("leaf", "main"), "main calls itself"),
        (edge("leaf", "leaf"), "leaf calls itself"),
        (edge("leaf", "__indirect_call"), "leaf calls through a pointer"),
        (edge("leaf", "printf"), "nothing is known of printf"),
    ],
)
def test_stacks_without_a_bound(more: str, why: str) -> None:
    with pytest.raises(UnboundedStackError, match=why):
        calls(GRAPH + more, LISTING).deepest("main")


def test_a_frame_of_no_fixed_size() -> None:
    with pytest.raises(UnboundedStackError, match="grows"):
        calls(node("grows", "64 bytes (dynamic)"))
