"""Untrusted text is escaped for a terminal: for every code point, and at every sink."""

from __future__ import annotations

import ast
import io
import sys
import unicodedata
from contextlib import redirect_stderr, redirect_stdout
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.panel import Panel
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from support.root import ROOT
from tools.cli import console
from tools.cli.visible_console import VisibleConsole
from tools.cli.visible_text import MAX_LINE, MAX_WORD, is_visible, one_line, visible

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.console import RenderableType

pytestmark = pytest.mark.slow

C0, C1 = range(0x20), range(0x7F, 0xA0)
BIDIRECTIONAL = [0x061C, 0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A)]
SEPARATORS = [0x2028, 0x2029]
ZERO_WIDTH = [0x00AD, 0x034F, 0x200B, 0x200C, 0x200D, 0x2060, 0xFEFF, 0xE0001]
NEVER = [*C0, *C1, *BIDIRECTIONAL, *SEPARATORS, *ZERO_WIDTH, 0xD800, 0xDCFF, 0xDFFF]
HOSTILE = "".join(map(chr, NEVER))


@pytest.mark.parametrize(
    "codes",
    [
        range(0x20000),
        range(0xE0000, 0xE1000),
        pytest.param(range(0x20000, 0xE0000), marks=pytest.mark.nightly),
        pytest.param(range(0xE1000, sys.maxunicode + 1), marks=pytest.mark.nightly),
    ],
    ids=lambda codes: f"{codes.start:X}",
)
def test_no_code_point_passes_that_acts_reorders_or_hides(codes: range) -> None:
    for code in codes:
        character = chr(code)
        shown = visible(character)
        if unicodedata.category(character) in {"Cc", "Cf", "Cs", "Zl", "Zp"}:
            assert shown.startswith("\\"), hex(code)
        if shown != character:
            assert shown.isascii(), hex(code)
            assert shown.isprintable(), hex(code)
            assert ast.literal_eval(f'"{shown}"') == character, hex(code)


@pytest.mark.parametrize("code", NEVER)
def test_control_sequences_are_escaped(code: int) -> None:
    assert visible(chr(code)).isascii()
    assert visible(chr(code)).isprintable()


@pytest.mark.parametrize(
    "text", ["", "m² ± 5 °", "Küche", "台所\u3000二", "a\u00a0b", "❤\ufe0f", "\\n"]
)
def test_comments_of_people_stay_unchanged(text: str) -> None:
    assert visible(text) == text


@given(st.text(st.characters(), max_size=30))
def test_escaping_twice_changes_nothing_more(text: str) -> None:
    assert visible(visible(text)) == visible(text)
    assert "\n" not in visible(text)


def test_a_long_word_and_a_long_line_are_shortened() -> None:
    word = one_line(f"no room '{'a' * 100_000}': give a file")
    assert len(word) < 300
    assert word.startswith("no room 'aaaa")
    assert word.endswith("': give a file")
    line = one_line("no room 'a " + "b " * 100_000 + "': give a file")
    assert len(line) < 600
    assert line.endswith("': give a file")
    assert one_line("x" * MAX_WORD) == "x" * MAX_WORD
    assert len(one_line("y " * MAX_LINE)) < MAX_LINE


# ---- the sinks ------------------------------------------------------------------------


SINKS: list[Callable[[str], None]] = [
    console.inform,
    console.inform_lines,
    console.print_error,
    console.ask,
    console.write_line,
    console.write_lines,
    lambda text: console.write_json({"name": text, text: 1}),
    lambda text: console.err().print(text),
    lambda text: console.plain_console().print(Text(text, "bold")),
]


@pytest.mark.parametrize("sink", SINKS)
def test_every_sink_escapes(sink: Callable[[str], None]) -> None:
    printed = io.StringIO()
    with redirect_stdout(printed), redirect_stderr(printed):
        sink(f"a name: {HOSTILE}[red]end")
    text = printed.getvalue()
    assert "a name" in text
    assert [c for c in text if c not in "\n\t" and not is_visible(c)] == []
    assert "[red]end" in text, "markup is not interpreted"


def drawn(picture: RenderableType, width: int) -> str:
    out = io.StringIO()
    shown = VisibleConsole()
    shown.file, shown.width = out, width
    shown.print(picture)
    return out.getvalue()


def table(text: str) -> Table:
    made = Table(title=Text(text), caption=text)
    made.add_column(text)
    made.add_column("number")
    made.add_row(text, "1")
    made.add_row(Text(text, "red"), "2")
    return made


class Raw:
    """A renderable that emits its text unchanged."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __rich_console__(self, *_given: object) -> Iterator[Segment]:
        yield Segment(self.text)


@pytest.mark.parametrize("made", [table, lambda text: Panel(text, title=text), Raw])
def test_pictures_contain_only_visible_characters(made: Callable[[str], RenderableType]) -> None:
    printed = drawn(made(f"x{HOSTILE}y"), 60)
    assert [c for c in printed if c != "\n" and not is_visible(c)] == []


@given(st.text(st.sampled_from("ab\x1b\x9b\u202e\u200b\t\n字"), max_size=40), st.integers(12, 60))
def test_an_escape_never_widens_a_table(text: str, width: int) -> None:
    lines = drawn(table(text), width).splitlines()
    bordered = {len(line.replace("字", "字 ")) for line in lines if "│" in line or "━" in line}
    assert len(bordered) <= 1
    assert max(bordered, default=0) <= width


def test_styles_stay_on_their_text() -> None:
    text = Text.assemble("a\x1bb", ("c\x9bd", "red"), "e")
    shown = VisibleConsole()
    styled = [s.text for s in shown.render(text, shown.options) if s.style and s.style.color]
    assert styled == ["c\\x9bd"]


# ---- no output without a sink ---------------------------------------------------------

SINK_FILES = {"console.py", "visible_console.py", "output_queue.py"}
STREAMS = {"stdout", "stderr", "__stdout__", "__stderr__"}


def direct_writes(tree: ast.Module) -> list[int]:
    """Return the numbers of lines that write to the terminal without a sink."""
    found = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        match node.func:
            case ast.Name(id="print" | "Console" | "input"):
                found.append(node.lineno)
            case ast.Attribute(value=ast.Name(id="click"), attr=name) if name in {
                *("echo", "secho", "prompt", "confirm", "pause", "clear", "echo_via_pager"),
            }:
                found.append(node.lineno)
            case ast.Attribute(value=ast.Attribute(value=ast.Name(id="sys"), attr=stream)) if (
                stream in STREAMS and node.func.attr not in {"isatty", "fileno", "reconfigure"}
            ):
                found.append(node.lineno)
            case ast.Attribute(value=ast.Attribute(attr="file" | "buffer"), attr="write"):
                found.append(node.lineno)
            case _:
                pass
    return found


def test_no_command_writes_beside_the_sinks() -> None:
    files = [path for path in (ROOT / "tools").rglob("*.py") if path.name not in SINK_FILES]
    assert len(files) > 50
    found = {
        f"{path.relative_to(ROOT)}:{line}"
        for path in files
        for line in direct_writes(ast.parse(path.read_text("utf-8")))
    }
    assert found == set()


@pytest.mark.parametrize(
    "text",
    [
        "print('x')",
        "sys.stdout.write('x')",
        "sys.stderr.flush()",
        "click.echo('x')",
        "Console()",
        "console.file.write('x')",
    ],
)
def test_the_search_finds_each_way_to_write(text: str) -> None:
    assert direct_writes(ast.parse(text)) == [1]
