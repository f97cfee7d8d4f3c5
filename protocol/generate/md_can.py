"""Tables of PROTOCOL.md: layout of each CAN frame, and bus load."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.can.frames import is_native, nominal_bits, parts_of, worst_bits
from protocol.can.load import BITRATE
from protocol.schema.message import Direction

if TYPE_CHECKING:
    from collections.abc import Iterator

    from protocol.can.frames import Part
    from protocol.schema.catalogue import Catalogue
    from protocol.schema.fields import Field
    from protocol.schema.message import MessageSpec


def can_tables(catalogue: Catalogue) -> Iterator[str]:
    """Yield the layout of every periodic frame, and the bus load."""
    yield "| identifier, node 1 | message | bytes | period |"
    yield "|---|---|---|---|"
    bits = worst = 0.0
    for spec in catalogue:
        if not is_native(spec):
            continue
        for part in parts_of(spec, len(spec.fields)):
            cells = _layout(spec, part)
            length = sum(size for _, size in cells)
            hz = 1e6 / part.slow_us if part.slow_us else spec.default_hz
            if spec.name != "wheel_duty":  # sent only in bring-up, instead of velocity setpoints
                bits += hz * nominal_bits(length)
                worst += hz * worst_bits(length)
            text = ", ".join(f"{size} `{field}`" for field, size in cells)
            name = f"`{spec.name}`" + ("" if spec.direction is Direction.DEVICE else " (host)")
            yield f"| 0x{part.can_type << 4 | 1:03x} | {name} | {text} | {_every(hz)} |"
    yield ""
    yield (
        f"At these rates the periodic frames, including setpoints, need {bits / 1000:.1f} kbit/s "
        f"without stuff bits and at most {worst / 1000:.1f} kbit/s with stuff bits. This is "
        f"{100 * bits / BITRATE:.1f} to {100 * worst / BITRATE:.1f} % of {BITRATE // 1000} "
        "kbit/s.\n"
    )


def _every(hz: float) -> str:
    return f"{1000 / hz:g} ms"


def _layout(spec: MessageSpec, part: Part) -> list[tuple[str, int]]:
    """Return name and size of each field in a frame, in byte order."""
    fields: list[Field] = [f for f in spec.fields if f.can_part == part.number]
    mine = [(f.name, f.wire.size) for f in fields]
    return [("t_us", 4) if part.full_stamp else ("t16", 2), *mine]
