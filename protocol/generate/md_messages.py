"""Tables of PROTOCOL.md: messages, layouts, enumerations, hashes."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from protocol.schema.message import Direction, RateClass

if TYPE_CHECKING:
    from collections.abc import Iterator

    from protocol.schema.catalogue import Catalogue
    from protocol.schema.fields import Field
    from protocol.schema.message import MessageSpec

_RATE = {RateClass.STREAM: "stream", RateClass.COMMAND: "command", RateClass.RARE: "rare"}
_SENDER = {Direction.HOST: "host", Direction.DEVICE: "device"}


def message_index(catalogue: Catalogue) -> Iterator[str]:
    """Yield the table of all messages, one row per message."""
    yield "## Messages\n"
    yield (
        "Integers are little-endian, without padding. *Stream*: periodic, not acknowledged. "
        "*Command*: has an id and is answered with `ack` or `nack`. *Rare*: all other messages. "
        "**b**: bootstrap message, used before schema negotiation; never changes.\n"
    )
    yield "| type | message | sender | kind | default rate | payload | meaning |"
    yield "|---|---|---|---|---|---|---|"
    for spec in catalogue:
        rate = f"{spec.default_hz:g} Hz" if spec.default_hz else ""
        kind = _RATE[spec.rate] + (" **b**" if spec.bootstrap else "")
        yield (
            f"| 0x{spec.type_id:02x} | [`{spec.name}`](#{spec.name}) | {_SENDER[spec.direction]} "
            f"| {kind} | {rate} | {_size(spec)} | {_cell(spec.doc)} |"
        )
    yield ""


def _size(spec: MessageSpec) -> str:
    return f"{spec.layout.size} B" + (" + text" if spec.text_field else "")


def message_section(spec: MessageSpec) -> Iterator[str]:
    """Yield the layout of one message."""
    rate = f", {spec.default_hz:g} Hz by default" if spec.default_hz else ""
    yield f"### {spec.name}\n"
    yield f"0x{spec.type_id:02x}, from the {_SENDER[spec.direction]}{rate}. {_cell(spec.doc)}\n"
    if not spec.fields:
        yield "No payload.\n"
        return
    yield "| offset | field | type | one step | unit | range | meaning |"
    yield "|---|---|---|---|---|---|---|"
    offset = 0
    for field in spec.fields:
        yield (
            f"| {offset} | `{field.name}` | {field.wire.name} | {_step(field)} | {_unit(field)} "
            f"| {_range(field)} | {_cell(_meaning(field))} |"
        )
        offset += field.wire.size
    yield ""


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ").replace("``", "`")


def _step(field: Field) -> str:
    if not field.is_scaled:
        return ""
    step = _number(field.scale)
    return f"{step}, 0 is {_number(field.offset)}" if field.offset else step


def _number(value: Fraction) -> str:
    """Format as a decimal if the decimal is exact and short, else as a fraction with its value."""
    decimal = f"{float(value):.10g}"
    return decimal if Fraction(decimal) == value else f"{value} ≈ {float(value):.6g}"


def _unit(field: Field) -> str:
    return "" if field.unit in {"enum", "bits", "text", "raw", "uid"} else field.unit


def _range(field: Field) -> str:
    if not field.wire.is_integer:
        return "to the end of the payload" if field.wire.is_text else f"{field.wire.size} B"
    if not field.is_scaled:
        whole = (field.low, field.high) == (field.wire.low, field.wire.high)
        return "" if whole else f"{field.low} … {field.high}"
    low, high = (float(raw * field.scale + field.offset) for raw in (field.low, field.high))
    return f"{low:.6g} … {high:.6g}"


def _meaning(field: Field) -> str:
    if field.enum is None:
        return field.doc
    name = field.enum.__name__
    return f"{field.doc} ([{name}](#{name.lower()}))"


def enum_tables(catalogue: Catalogue) -> Iterator[str]:
    """Yield the values of all enumerations."""
    yield "## Enumerations\n"
    for name, enum, unit, *_ in catalogue.enums.values():
        users = ", ".join(
            f"`{s.name}.{f.name}`" for s in catalogue for f in s.fields if f.enum is enum
        )
        doc = " ".join((enum.__doc__ or "").split())
        yield f"### {name}\n\n{doc} Used in {users}.\n"
        yield f"| {'bit' if unit == 'bits' else 'value'} | name |"
        yield "|---|---|"
        for member in enum:
            value = int(member).bit_length() - 1 if unit == "bits" else int(member)
            yield f"| {value} | `{(member.name or '').lower()}` |"
        yield ""


def hash_table(catalogue: Catalogue) -> Iterator[str]:
    """Yield the hash chains of all messages and enumerations."""
    yield "| message | fields | chain before the first field | after the last |"
    yield "|---|---|---|---|"
    for spec in catalogue:
        chain = catalogue.chains[spec.type_id]
        yield f"| `{spec.name}` | {len(spec.fields)} | {chain[0]:08x} | {chain[-1]:08x} |"
    yield ""
    example = next(spec for spec in catalogue if spec.fields)
    yield f"The chain of `{example.name}`, step by step:\n"
    yield "| hashed text | value |"
    yield "|---|---|"
    texts = example.canonical()
    for text, value in zip(texts, catalogue.chains[example.type_id], strict=True):
        yield f"| `{_cell(text)}` | {value:08x} |"
    yield ""
    yield "| enumeration | members | key | chain after the last |"
    yield "|---|---|---|---|"
    for enum in catalogue.enums.values():
        row = f"| `{enum.name}` | {len(enum.members)} | {enum.key:08x} | {enum.chain[-1]:08x} |"
        yield row
    yield ""
