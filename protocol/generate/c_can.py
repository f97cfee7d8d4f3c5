"""C tables for classic CAN: the fields of each message in each native frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.can.frames import is_native, parts_of
from protocol.generate.c_messages import guarded
from protocol.schema.message import Direction

if TYPE_CHECKING:
    from collections.abc import Iterator

    from protocol.schema.catalogue import Catalogue
    from protocol.schema.message import MessageSpec


def spans(catalogue: Catalogue) -> str:
    """Return the rows of the table of native frames."""
    slow = slow_parts(catalogue)
    return "".join(guarded(s, "".join(_spans(s, slow))) for s in catalogue if is_native(s))


def host_parts(catalogue: Catalogue) -> int:
    """Return the maximum number of CAN frames of a host's periodic message."""
    return max(
        (
            len(parts_of(s, len(s.fields)))
            for s in catalogue
            if is_native(s) and s.direction is Direction.HOST
        ),
        default=1,
    )


def slow_parts(catalogue: Catalogue) -> dict[int, int]:
    """Return the period, µs, of each CAN type that is sent more slowly than its message."""
    parts = [p for s in catalogue if is_native(s) for p in parts_of(s, len(s.fields))]
    return {p.can_type: p.slow_us for p in parts if p.slow_us}


def _spans(spec: MessageSpec, slow: dict[int, int]) -> Iterator[str]:
    for part in parts_of(spec, len(spec.fields)):
        place = list(slow).index(part.can_type) + 1 if part.slow_us else 0
        full = int(part.full_stamp)
        for first, end in part.spans:
            yield (
                f"    {{0x{part.can_type:02X}u, 0x{spec.type_id:02X}u, {first}u, {end - first}u, "
                f"{place}u, {full}u}}, /* {spec.name} */\n"
            )
