"""C for each message: struct, sizes, encode, decode, SI values."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.authentication import SIGNED_TYPES
from protocol.generate.c_text import (
    c_type,
    comment,
    float_literal,
    identifier,
    lines,
    meaning,
    plain,
    snake,
    upper,
)
from protocol.messages.values import StopCause, by_severity, latched_cause
from protocol.schema.message import Direction, RateClass

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from enum import IntEnum

    from protocol.schema.catalogue import Catalogue, EnumSpec
    from protocol.schema.fields import Field
    from protocol.schema.message import MessageSpec

_WIDTHS = {"u16": "u16", "i16": "u16", "u32": "u32"}


def enums(catalogue: Catalogue) -> str:
    """Return one C enum for each enumeration that a field uses, sorted by name."""
    found = sorted((snake(spec.name), spec.enum) for spec in catalogue.enums.values())
    return "\n".join(_enum(name, enum) for name, enum in found)


def _enum(name: str, enum: type[IntEnum]) -> str:
    members = [f"    SP_{name.upper()}_{m.name} = {m.value}" for m in enum]
    doc = ((enum.__doc__ or "").strip() or name).splitlines()[0]
    return lines([comment(doc), "enum {", ",\n".join(members), "};"])


def latch_rule(catalogue: Catalogue) -> str:
    """Return the C function for the stop cause that a device latches.

    It is empty if no message of the catalogue has a stop cause.
    """
    if not any(field.enum is StopCause for spec in catalogue for field in spec.fields):
        return ""
    gravest, unnamed = max(StopCause).name, latched_cause(StopCause.NONE, StopCause.NONE).name
    return lines(
        [
            comment(
                "Cause that a device latches for a stop: the more severe of the latched cause "
                "(held) and the new one (cause). Ascending "
                f"severity: {', '.join(c.name.lower() for c in by_severity())}."
            ),
            "static inline uint8_t sp_latched_cause(uint8_t held, uint8_t cause)",
            "{",
            f"    if (cause == SP_STOP_CAUSE_NONE || cause > SP_STOP_CAUSE_{gravest}) {{",
            f"        cause = SP_STOP_CAUSE_{unnamed}; /* NONE, or unknown to this version */",
            "    }",
            "    return cause > held ? cause : held;",
            "}",
        ]
    )


def to_all(catalogue: Catalogue) -> str:
    """Return the function that is true for messages that may have node 0."""
    return _one_of(
        "/* Whether a message may be addressed to SP_NODE_ALL. A device ignores every other\n"
        " * message with that address, in the same way as messages for other nodes. */\n",
        "sp_to_all",
        [spec for spec in catalogue if spec.to_all],
    )


def needs_tag(catalogue: Catalogue) -> str:
    """Return the function that is true for messages that need a tag on a device with a key."""
    return _one_of(
        "/* Whether a device that has a key takes a message only with its tag. */\n",
        "sp_needs_tag",
        [spec for spec in catalogue if spec.needs_tag],
    )


def may_have_tag(catalogue: Catalogue) -> str:
    """Return the function that is true for messages that a host with a key signs."""
    return _one_of(
        "/* Whether a host that has a key signs a message. */\n",
        "sp_may_have_tag",
        [spec for spec in catalogue if spec.type_id in SIGNED_TYPES],
    )


def _one_of(comment: str, name: str, specs: list[MessageSpec]) -> str:
    """Return a function that is true for the types of these messages."""
    cases = [guarded(spec, f"    case SP_TYPE_{upper(spec)}:\n") for spec in specs]
    return (
        f"{comment}static inline bool {name}(uint8_t type)\n"
        "{\n"
        "    switch (type) {\n" + "".join(cases) + "        return true;\n"
        "    default:\n"
        "        return false;\n"
        "    }\n"
        "}\n"
    )


def streams(catalogue: Catalogue) -> str:
    """Return the macro that applies another macro to each stream of a device, by ascending type."""
    wanted = sorted(
        (s for s in catalogue if s.direction is Direction.DEVICE and s.rate is RateClass.STREAM),
        key=lambda spec: spec.type_id,
    )
    out = []
    for spec in wanted:
        name = f"#define SP_STREAM_{upper(spec)}(X)"
        macro = switch_macro(spec)
        entry = f"{name} X({upper(spec)}, {spec.name})"
        out += [entry] if macro is None else [f"#if {macro}", entry, "#else", name, "#endif"]
    out.append(
        comment(
            "The streams of a device by rising type, which is the order of sending. The macro "
            "applies X(NAME, name) to each stream. NAME and name are the stream's name in capitals "
            "and in small letters, for example for SP_TYPE_NAME and sp_name_encode()."
        )
    )
    used = [f"    SP_STREAM_{upper(spec)}(X)" for spec in wanted]
    out.append(" \\\n".join(["#define SP_DEVICE_STREAMS(X)", *used]))
    return lines(out)


def switch_macro(spec: MessageSpec) -> str | None:
    """Return the name of the macro that excludes the message; None if it is always included."""
    return None if spec.bootstrap else f"SP_WITH_{upper(spec)}"


def switches(catalogue: Catalogue) -> str:
    """Return the default of every switch."""
    out = []
    for spec in catalogue:
        macro = switch_macro(spec)
        if macro is not None:
            default = "1" if spec.minimal else "SP_WITH_REST"
            out += [f"#ifndef {macro}", f"#define {macro} {default}", "#endif"]
    return lines(out)


def guarded(spec: MessageSpec, body: str) -> str:
    """Return ``body`` under the condition that the message is included."""
    macro = switch_macro(spec)
    return body if macro is None else f"#if {macro}\n{body}#endif\n"


# ---- header ---------------------------------------------------------------------------------


def declaration(spec: MessageSpec) -> str:
    """Return constants, struct, prototypes and inline helpers of one message."""
    name, big = spec.name, upper(spec)
    sender = "device" if spec.direction is Direction.DEVICE else "host"
    rate = f", {spec.default_hz:g} Hz" if spec.rate is RateClass.STREAM else ""
    out = [
        comment(f"{name} (0x{spec.type_id:02X}, {sender}{rate}): {spec.doc.splitlines()[0]}"),
        f"#define SP_TYPE_{big} 0x{spec.type_id:02X}u",
        f"#define SP_{big}_SIZE {spec.layout.size}u",
    ]
    if spec.rate is RateClass.STREAM:
        out.append(f"#define SP_{big}_HZ {spec.default_hz:g}")
    out += [
        f"#define SP_{big}_{f.name.upper()}_NONE {f.none}u"
        for f in spec.fields
        if f.none is not None
    ]
    out += ["typedef struct {", *_members(spec), f"}} sp_{name}_t;"]
    out += [
        f"int sp_{name}_encode(const sp_{name}_t *message, uint8_t *payload, size_t capacity);",
        f"bool sp_{name}_decode(sp_{name}_t *message, const uint8_t *payload, size_t length);",
        *_frame_helper(spec),
    ]
    floats = list(_si(spec))
    if floats:
        out += ["#ifndef SP_NO_FLOAT", *floats, "#endif"]
    return guarded(spec, lines(out))


def _members(spec: MessageSpec) -> Iterator[str]:
    if spec.is_bare:
        yield "    uint8_t nothing; /* no fields: the type is the whole message */"
    for field in spec.fields:
        yield comment(meaning(field), "    ")
        name = identifier(field.name)
        if field.wire.is_text:
            yield f"    const char *{name}; /* not ended by a zero; decoded: inside the payload */"
            yield f"    uint8_t {name}_length;"
        elif field.wire.is_integer:
            yield f"    {c_type(field)} {name};"
        else:
            yield f"    uint8_t {name}[{field.wire.size}];"


def _frame_helper(spec: MessageSpec) -> list[str]:
    name = spec.name
    if spec.is_bare:
        return [
            "/* Its node, number and stamp are 0, so the bytes are the same from every sender. */",
            f"static inline size_t sp_{name}_frame(",
            f"    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_{name}_t *message)",
            "{",
            "    sp_sender_t anybody = {0u, 0u, 0u, 0u};",
            "    (void)t_us;",
            "    (void)message;",
            "    sender->frames++;",
            f"    return sp_seal(frame, &anybody, SP_TYPE_{upper(spec)}, 0u, 0u);",
            "}",
        ]
    seal = f"sp_seal(frame, sender, SP_TYPE_{upper(spec)}, t_us, (size_t)length)"
    return [
        f"static inline size_t sp_{name}_frame(",
        f"    uint8_t *frame, sp_sender_t *sender, uint32_t t_us, const sp_{name}_t *message)",
        "{",
        f"    const int length = sp_{name}_encode(message, sp_payload(frame), SP_PAYLOAD_MAX);",
        f"    return length < 0 ? 0u : {seal};",
        "}",
    ]


def _si(spec: MessageSpec) -> Iterator[str]:
    for field in spec.fields:
        suffix = field.si_suffix
        if suffix is None:
            continue
        stem = f"sp_{spec.name}_{field.name}"
        gain, offset = float_literal(field.si_gain), float_literal(field.si_offset)
        plus = f" + {offset}" if field.offset else ""
        less = f" - {offset}" if field.offset else ""
        yield f"static inline float {stem}{suffix}(const sp_{spec.name}_t *message)"
        yield "{"
        yield f"    return (float)message->{identifier(field.name)} * {gain}{plus};"
        yield "}"
        yield f"static inline {c_type(field)} {stem}_from{suffix}(float value)"
        yield "{"
        inverse = f"(value{less}) / {gain}" if less else f"value / {gain}"
        low, high = (float_literal(float(x)) for x in (field.low, field.high))
        yield f"    return ({c_type(field)})sp_round({inverse}, {low}, {high});"
        yield "}"


# ---- source ---------------------------------------------------------------------------------


def definition(spec: MessageSpec) -> str:
    """Return the functions that encode and decode one message."""
    name = spec.name
    return guarded(spec, lines([*_encode(spec, name), "", *_decode(spec, name)]))


def _encode(spec: MessageSpec, name: str) -> Iterator[str]:
    size = f"SP_{upper(spec)}_SIZE"
    yield f"int sp_{name}_encode(const sp_{name}_t *message, uint8_t *payload, size_t capacity)"
    yield "{"
    if spec.is_bare:
        yield "    (void)message;\n    (void)payload;\n    (void)capacity;\n    return 0;\n}"
        return
    text = spec.text_field
    if text is None:
        yield f"    if (capacity < {size}) {{"
    else:
        yield f"    const size_t length = {size} + (size_t)message->{identifier(text.name)}_length;"
        yield "    if (capacity < length || SP_PAYLOAD_MAX < length) {"
    yield "        return -1;"
    yield "    }"
    at = 0
    for field in spec.fields:
        yield f"    {_put(field, at)}"
        at += field.wire.size
    yield f"    return (int){size if text is None else 'length'};"
    yield "}"


def _put(field: Field, at: int) -> str:
    source = f"message->{identifier(field.name)}"
    target = f"payload + {at}" if at else "payload"
    if field.wire.is_text:
        return f"sp_copy({target}, (const uint8_t *){source}, {source}_length);"
    if not field.wire.is_integer:
        return f"sp_copy({target}, {source}, {field.wire.size}u);"
    width = _WIDTHS.get(field.wire.name)
    if width is None:
        return f"payload[{at}] = {source};"
    value = f"(uint16_t){source}" if field.wire.low < 0 else source
    return f"sp_put_{width}({target}, {value});"


def _decode(spec: MessageSpec, name: str) -> Iterator[str]:
    size = f"SP_{upper(spec)}_SIZE"
    yield f"bool sp_{name}_decode(sp_{name}_t *message, const uint8_t *payload, size_t length)"
    yield "{"
    if spec.is_bare:
        yield "    (void)payload;\n    (void)length;"
        yield "    message->nothing = 0;\n    return true;\n}"
        return
    # A bootstrap message may be longer: a later version may extend it.
    if spec.text_field is not None:
        yield f"    if (length < {size} || SP_PAYLOAD_MAX < length) {{"
    else:
        yield f"    if (length {'<' if spec.bootstrap else '!='} {size}) {{"
    yield "        return false;"
    yield "    }"
    at = 0
    for field in spec.fields:
        yield from (f"    {line}" for line in _get(spec, field, at))
        at += field.wire.size
    yield "    return true;"
    yield "}"


def _get(spec: MessageSpec, field: Field, at: int) -> Iterator[str]:
    target = f"message->{identifier(field.name)}"
    source = f"payload + {at}" if at else "payload"
    kind = field.wire.name
    if field.wire.is_text:
        yield f"{target} = (const char *)({source});"
        yield f"{target}_length = (uint8_t)(length - SP_{upper(spec)}_SIZE);"
    elif not field.wire.is_integer:
        yield f"sp_copy({target}, {source}, {field.wire.size}u);"
    elif kind == "u8":
        yield f"{target} = payload[{at}];"
    else:
        yield f"{target} = sp_get_{kind}({source});"


# ---- schema ---------------------------------------------------------------------------------


def table_rows(catalogue: Catalogue) -> str:
    """Return type, number of fields and fixed size of each message.

    The top bit of the type is set if the device sends the message.
    """
    out = []
    for spec in catalogue:
        who = " | SP_DEVICE_BIT" if spec.direction is Direction.DEVICE else ""
        row = f"{{SP_TYPE_{upper(spec)}{who}, {len(spec.fields)}u, SP_{upper(spec)}_SIZE}},"
        out.append(guarded(spec, f"    {row}\n"))
    return "".join(out)


def chain_rows(catalogue: Catalogue) -> str:
    """Return the hash-chain values of each message, before the first field and after each field."""
    return "".join(
        guarded(spec, _chain_rows(spec.name, catalogue.chains[spec.type_id])) for spec in catalogue
    )


def enum_members(catalogue: Catalogue) -> str:
    """Return the number of members of each enumeration, if a message that uses it is included."""
    return "".join(
        _guarded_enum(catalogue, e, f"    {len(e.members)}u, /* {e.name} */\n")
        for e in catalogue.enums.values()
    )


def enum_rows(catalogue: Catalogue) -> str:
    """Return the hash chains of the enumerations."""
    return "".join(
        _guarded_enum(catalogue, e, _chain_rows(e.name, e.chain)) for e in catalogue.enums.values()
    )


def _guarded_enum(catalogue: Catalogue, enum: EnumSpec, body: str) -> str:
    """Return ``body`` under the condition that a message with the enumeration is included."""
    macros = [
        switch_macro(spec)
        for spec in catalogue
        if any(f.enum is not None and f.enum.__name__ == enum.name for f in spec.fields)
    ]
    named = [m for m in macros if m is not None]
    return f"#if {' || '.join(named)}\n{body}#endif\n" if len(named) == len(macros) else body


def _chain_rows(name: str, chain: Sequence[int]) -> str:
    values = [f"0x{v:08X}u" for v in chain]
    rows = [", ".join(values[i : i + 6]) + ",\n" for i in range(0, len(values), 6)]
    return f"    /* {plain(name)} */\n" + "".join(f"    {row}" for row in rows)


def size_rows(catalogue: Catalogue) -> str:
    """Return the sizes of each message's fields."""
    return "".join(
        guarded(s, "    " + "".join(f"{f.wire.size}u, " for f in s.fields) + f"/* {s.name} */\n")
        for s in catalogue
    )


def bootstrap_cases(catalogue: Catalogue) -> str:
    """Return the labels of the bootstrap messages."""
    return "".join(f"    case SP_TYPE_{upper(s)}:\n" for s in catalogue if s.bootstrap)
