"""Check that no identifier contains a retired word of the glossary.

``python -m tools.dev.vocabulary`` reads the retired words from ``docs/glossary.md`` and checks
every name that our Python files define or our C files use. It prints one line for each name with
such a word, and exits with 1 if there is any. Names that must keep a retired word are listed in
``pyproject.toml`` under ``[tool.sweepctl.vocabulary]``, each with its reason.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from tools.cli.console import write_line

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("bridge", "protocol", "sim_device", "tools", "tests", "examples")
FILES = ("sweepctl_pytest.py", "setup.py")

_C_SUFFIXES = (".c", ".h")
_C_IDENTIFIER = re.compile(r"\b[A-Za-z_]\w*")
_C_TEXT = re.compile(r"/\*.*?\*/|//[^\n]*|\"(?:\\.|[^\"\\\n])*\"", re.DOTALL)
"""Comments and string literals."""

_ROW = re.compile(r"^\| `([^`]+)` \| (.+?) \|$")
_WORD = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")


class Name(NamedTuple):
    """An identifier and the place of its definition."""

    line: int
    text: str


class Hit(NamedTuple):
    """A retired word in an identifier."""

    path: Path
    name: Name
    word: str
    instead: str

    def __str__(self) -> str:
        """Format as one line that an editor can follow."""
        place = f"{self.path}:{self.name.line}"
        return f"{place}: {self.name.text}: '{self.word}' is retired; use {self.instead}"


def retired_words(glossary: str) -> dict[str, str]:
    """Read the table under "Retired words": each word and its replacement."""
    _, _, section = glossary.partition("## Retired words")
    rows = (_ROW.match(line) for line in section.splitlines())
    return {row[1]: row[2] for row in rows if row}


def defined_names(source: str) -> Iterator[Name]:
    """Yield each identifier that Python code defines, with its line."""
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                yield Name(node.lineno, node.name)
            case ast.arg():
                yield Name(node.lineno, node.arg)
            case ast.Name(ctx=ast.Store()):
                yield Name(node.lineno, node.id)
            case ast.Attribute(ctx=ast.Store()):
                yield Name(node.lineno, node.attr)
            case ast.alias(asname=str(alias)):
                yield Name(node.lineno, alias)
            case ast.ExceptHandler(name=str(caught)):
                yield Name(node.lineno, caught)
            case ast.MatchAs(name=str(captured)) | ast.MatchStar(name=str(captured)):
                yield Name(node.lineno, captured)
            case _:
                pass


def c_names(source: str) -> Iterator[Name]:
    """Yield each identifier of C code once, with the line of its first use."""
    code = _C_TEXT.sub(lambda text: "\n" * text[0].count("\n"), source)
    seen = set()
    for number, line in enumerate(code.splitlines(), 1):
        for name in _C_IDENTIFIER.findall(line):
            if name not in seen:
                seen.add(name)
                yield Name(number, name)


def retired_in(name: str, words: Iterable[str]) -> list[str]:
    """Return the retired words of an identifier.

    An entry of two words matches if the identifier contains the two words side by side. An entry
    that ends with ``_`` matches only at the beginning of an identifier of several words.
    """
    parts = [part.lower() for part in _WORD.findall(name)]
    joined = f" {' '.join(parts)} "
    found = []
    for word in words:
        if word.endswith("_"):
            if len(parts) > 1 and parts[0] == word[:-1]:
                found.append(word)
        elif f" {word} " in joined:
            found.append(word)
    return found


def source_files(root: Path) -> Iterator[Path]:
    """Yield our Python and C files, sorted; folders named ``build`` contain none of ours."""
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            built = "build" in path.relative_to(root).parts
            if path.suffix in {".py", *_C_SUFFIXES} and not built:
                yield path
    yield from (root / name for name in FILES)


def check(root: Path, words: dict[str, str], allowed: set[str]) -> tuple[list[Hit], set[str]]:
    """Check every file under ``root``.

    Returns:
        The hits that are not allowed, and the allowed names that no file defines any more.

    """
    hits, unused = [], set(allowed)
    for path in source_files(root):
        place = path.relative_to(root)
        names_in = c_names if path.suffix in _C_SUFFIXES else defined_names
        names = [Name(1, path.stem), *names_in(path.read_text(encoding="utf-8"))]
        for name in names:
            found = retired_in(name.text, words)
            if found and name.text in allowed:
                unused.discard(name.text)
            else:
                hits += [Hit(place, name, word, words[word]) for word in found]
    return hits, unused


def main() -> int:
    """Check the project and return the exit status."""
    words = retired_words((ROOT / "docs" / "glossary.md").read_text(encoding="utf-8"))
    table = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    allowed = table["tool"]["sweepctl"]["vocabulary"]["allowed"]
    hits, unused = check(ROOT, words, set(allowed))
    for hit in hits:
        write_line(str(hit))
    for name in sorted(unused):
        write_line(f"pyproject.toml: vocabulary: {name} is allowed but not defined: remove it")
    return int(bool(hits or unused))


if __name__ == "__main__":
    sys.exit(main())
