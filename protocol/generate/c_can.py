"""C for classic CAN: what a device sends, packed or cut up, and what a host sends, put together."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.can.frames import CAN_FULL_STAMP, STAMP_SHIFT, is_native, parts_of
from protocol.can.link import DOUBLE_US
from protocol.can.stamps import DRIFT_PPM, LEAD_US, OLDEST_US, STEP_US
from protocol.can.transfers import FLAG_WHOLE_STAMP, OPEN_US
from protocol.generate.c_can_receive_text import RECEIVE
from protocol.generate.c_can_text import HEADER, SEND
from protocol.generate.c_messages import guarded
from protocol.schema.message import Direction

if TYPE_CHECKING:
    from collections.abc import Iterator

    from protocol.schema.catalogue import Catalogue
    from protocol.schema.message import MessageSpec

_PPM = 1_000_000


class HostPartsError(ValueError):
    """A host's periodic message in several frames, which the C receiver does not join."""

    def __init__(self, message: str) -> None:
        super().__init__(f"{message}: a host's message needs more than one CAN frame")
        self.message = message


def header(catalogue: Catalogue) -> str:
    """Types and prototypes."""
    return HEADER.format(messages=len(catalogue.specs), slow=max(1, len(_slow(catalogue))))


def source(catalogue: Catalogue) -> str:
    """Tables and functions.

    Raises:
        HostPartsError: a host's periodic message does not fit one frame.

    """
    slow = _slow(catalogue)
    spans = "".join(guarded(s, "".join(_spans(s, slow))) for s in catalogue if is_native(s))
    send = SEND.format(
        spans=spans,
        slow=", ".join(f"{us}u" for us in slow.values()) or "0u",
        shift=STAMP_SHIFT,
        whole=FLAG_WHOLE_STAMP,
    )
    receive = RECEIVE.format(
        shift=STAMP_SHIFT,
        double=DOUBLE_US,
        open=OPEN_US,
        oldest=OLDEST_US,
        lead=LEAD_US,
        step=STEP_US,
        drift=_PPM // DRIFT_PPM,
    )
    return f"{send}\n{receive}"


def _slow(catalogue: Catalogue) -> dict[int, int]:
    parts = [p for s in catalogue if is_native(s) for p in parts_of(s, len(s.fields))]
    return {p.can_type: p.slow_us for p in parts if p.slow_us}


def _spans(spec: MessageSpec, slow: dict[int, int]) -> Iterator[str]:
    parts = parts_of(spec, len(spec.fields))
    if spec.direction is Direction.HOST and len(parts) > 1:
        raise HostPartsError(spec.name)
    for part in parts:
        place = list(slow).index(part.can_type) + 1 if part.slow_us else 0
        full = int(part.can_type in CAN_FULL_STAMP)
        for first, end in part.spans:
            yield (
                f"    {{0x{part.can_type:02X}u, 0x{spec.type_id:02X}u, {first}u, {end - first}u, "
                f"{place}u, {full}u}}, /* {spec.name} */\n"
            )
