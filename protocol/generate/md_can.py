"""Tables of PROTOCOL.md: layout of each CAN frame, and bus load."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.can.frames import is_native
from protocol.can.load import BITRATE, all_parts, part_hz, periodic_loads
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
    for spec in catalogue:
        if not is_native(spec):
            continue
        for part in all_parts(spec):
            text = ", ".join(f"{size} `{field}`" for field, size in _layout(spec, part))
            name = f"`{spec.name}`" + ("" if spec.direction is Direction.DEVICE else " (host)")
            every = _every(part_hz(spec, part))
            yield f"| 0x{part.can_type << 4 | 1:03x} | {name} | {text} | {every} |"
    yield ""
    # Duty setpoints are sent only in bring-up, instead of velocity setpoints.
    rows = [row for row in periodic_loads(catalogue) if row.name != "wheel_duty"]
    bits = sum(row.bits_per_s for row in rows)
    worst = sum(row.worst_bits_per_s for row in rows)
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
