"""The C adapter's table of messages, and the text format of its input and output."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.generate.c_text import c_type, identifier
from protocol.uart.framing import MAX_PAYLOAD

if TYPE_CHECKING:
    import random
    from collections.abc import Iterable, Iterator

    from protocol.schema.fields import Field
    from protocol.schema.message import Message, MessageSpec


def table(specs: Iterable[MessageSpec]) -> str:
    """Return C text that defines ``adapter_messages``."""
    specs = list(specs)
    rows = [f"    {{SP_TYPE_{s.name.upper()}, show_{s.name}, frame_{s.name}, again_{s.name}, "
            f"si_{s.name}}}," for s in specs]  # fmt: skip
    return "\n".join(
        [
            '#include "adapter.h"\n#include <stdio.h>\n#include <string.h>\n',
            *("\n".join(_message(s)) for s in specs),
            "const adapter_message_t adapter_messages[] = {",
            *rows,
            "};",
            f"const size_t adapter_message_count = {len(specs)};\n",
        ]
    )


def _message(spec: MessageSpec) -> Iterator[str]:
    n = spec.name
    yield f"static bool show_{n}(const uint8_t *p, size_t k) {{"
    yield f"    sp_{n}_t m;"
    yield f"    if (!sp_{n}_decode(&m, p, k)) {{ return false; }}"
    for field in spec.fields:
        yield from (f"    {line}" for line in _show(field))
    yield "    return true;\n}"
    yield f"static size_t frame_{n}(uint8_t *f, sp_sender_t *s, uint32_t t, char **w) {{"
    yield f"    sp_{n}_t m;"
    if spec.is_bare:
        yield "    (void)w; m.nothing = 0;"
    for index, field in enumerate(spec.fields):
        yield f"    {_fill(field, index)}"
    yield f"    return sp_{n}_frame(f, s, t, &m);\n}}"
    yield f"static int again_{n}(const uint8_t *p, size_t k, uint8_t *out, size_t room) {{"
    yield f"    sp_{n}_t m;"
    yield f"    return sp_{n}_decode(&m, p, k) ? sp_{n}_encode(&m, out, room) : -1;\n}}"
    yield f"static void si_{n}(const uint8_t *p, size_t k) {{"
    yield f"    sp_{n}_t m;"
    yield f"    if (!sp_{n}_decode(&m, p, k)) {{ return; }}"
    for field in spec.fields:
        if field.si_suffix is not None:
            call = f"sp_{n}_{field.name}{field.si_suffix}(&m)"
            back = f"sp_{n}_{field.name}_from{field.si_suffix}({call})"
            name = f"{field.name}{field.si_suffix}"
            yield f'    printf(" {name}=%.9g:%ld", (double){call}, (long){back});'
    yield "}"


def _show(field: Field) -> Iterator[str]:
    name = identifier(field.name)
    yield f'printf(" {field.name}=");'
    if field.wire.is_text:
        yield f"adapter_hex(m.{name}, m.{name}_length);"
    elif field.wire.is_integer:
        yield f'printf("%lld", (long long)m.{name});'
    else:
        yield f"adapter_hex(m.{name}, sizeof m.{name});"


def _fill(field: Field, index: int) -> str:
    name = identifier(field.name)
    if field.wire.is_text:
        return f"m.{name}_length = (uint8_t)adapter_unhex(w[{index}]); m.{name} = w[{index}];"
    if field.wire.is_integer:
        return f"m.{name} = ({c_type(field)})adapter_number(w[{index}]);"
    return f"(void)adapter_unhex(w[{index}]); memcpy(m.{name}, w[{index}], sizeof m.{name});"


# ---- messages in the adapter's text format -----------------------------------------------------

_LETTERS = "abc xyz_09\0é☂𝄞"


def random_message(rng: random.Random, spec: MessageSpec) -> Message:
    """Return a message with random raw values, often at the ends of their ranges."""
    return spec.cls(*(_random_value(rng, spec, field) for field in spec.fields))


def _random_value(rng: random.Random, spec: MessageSpec, field: Field) -> int | str | bytes:
    if field.wire.is_text:
        room = MAX_PAYLOAD - spec.layout.size
        letters = rng.choices(_LETTERS, k=rng.choice((0, 1, 5, 20, room)))
        return "".join(letters).encode()[:room].decode(errors="ignore")
    if not field.wire.is_integer:
        return rng.randbytes(field.wire.size)
    if rng.random() < 0.2:
        return rng.choice((field.wire.low, field.wire.high, 0))
    return rng.randint(field.wire.low, field.wire.high)


def words(message: Message) -> list[str]:
    """Return the values in the text format that the adapter reads and prints."""
    return [_word(value) for value in message]


def _word(value: int | str | bytes) -> str:
    if isinstance(value, int):
        return str(value)
    return (value.encode() if isinstance(value, str) else value).hex() or "-"


def shown(spec: MessageSpec, message: Message) -> str:
    """Return what the adapter prints for a decoded message."""
    pairs = zip(spec.fields, words(message), strict=True)
    return "".join(f" {field.name}={word}" for field, word in pairs)
