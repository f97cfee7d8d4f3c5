"""Every message of the protocol, declared once in ``host`` or ``device``.

A message's type is also its CAN priority (``id = type << 4 | node``). A lower type is more urgent,
so a stop wins arbitration over everything. Fields may only be appended. An appended field is
``int | None``: a peer that does not declare it omits it.
"""

from __future__ import annotations

from protocol.messages import device, host
from protocol.schema.message import declared_in

ALL_MESSAGES = (*declared_in(host), *declared_in(device))
"""The catalogue: all declarations of the two modules."""
