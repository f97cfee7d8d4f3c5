"""Names, types and comments of the generated C."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from protocol.schema.fields import Field
    from protocol.schema.message import MessageSpec

WIDTH = 96

# Reserved words of C99, then reserved words of C++ (a C++ compiler may include the header).
_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline
int long register restrict return short signed sizeof static struct switch typedef union
unsigned void volatile while bool true false
and asm catch class compl constexpr delete explicit export friend mutable namespace new not
nullptr operator or private protected public template this throw try typeid typename using
virtual wchar_t xor
"""
_RESERVED = frozenset(_WORDS.split())
_ASCII = {"×": "x", "±": "+-", "°": "deg", "²": "2", "·": "*", "–": "-", "−": "-", "’": "'"}
_C_TYPES = {"u8": "uint8_t", "u16": "uint16_t", "u32": "uint32_t", "i16": "int16_t"}


def identifier(name: str) -> str:
    """Return a field's name, with a trailing underscore if C reserves the word."""
    return f"{name}_" if name in _RESERVED else name


def c_type(field: Field) -> str:
    """Return the C type of an integer field."""
    return _C_TYPES[field.wire.name]


def upper(spec: MessageSpec) -> str:
    """Return the message's name for macros."""
    return spec.name.upper()


def plain(text: str) -> str:
    """Return the text in ASCII, without a sequence that ends a C comment."""
    for sign, words in _ASCII.items():
        text = text.replace(sign, words)
    text = text.encode("ascii", "replace").decode().replace("``", "").replace("*/", "* /")
    return " ".join(text.split())


def comment(text: str, indent: str = "") -> str:
    """Return a block comment, wrapped."""
    lines = textwrap.wrap(plain(text), WIDTH - len(indent) - 6)
    if len(lines) == 1:
        return f"{indent}/* {lines[0]} */"
    return "\n".join([f"{indent}/* {lines[0]}", *(f"{indent} * {x}" for x in lines[1:])]) + " */"


def meaning(field: Field) -> str:
    """Return meaning, unit, scale and range of a field in one line."""
    parts = [plain(field.doc)]
    if field.is_scaled:
        parts.append(f"1 step = {float(field.scale):.9g} {plain(field.unit)}")
        if field.offset:
            parts.append(f"0 = {float(field.offset):.9g} {plain(field.unit)}")
    elif field.unit not in {"text", "uid", "raw", "enum", "bits"}:
        parts.append(plain(field.unit))
    if field.enum is not None:
        parts.append(f"SP_{snake(field.enum.__name__).upper()}_*")
    if field.wire.is_integer and (field.low, field.high) != (field.wire.low, field.wire.high):
        parts.append(f"{field.low}..{field.high}")
    if field.none is not None:
        parts.append(f"{field.none}: none")
    return "; ".join(parts)


def snake(name: str) -> str:
    """Convert ``StopCause`` to ``stop_cause``."""
    return "".join(f"_{c.lower()}" if c.isupper() and i else c.lower() for i, c in enumerate(name))


def float_literal(value: float) -> str:
    """Return the nearest ``float`` in C notation."""
    text = f"{value:.9g}"
    return f"{text}f" if any(c in text for c in ".e") else f"{text}.0f"


def lines(parts: Iterable[str]) -> str:
    """Join the parts, with a newline at the end."""
    return "\n".join(parts) + "\n"
