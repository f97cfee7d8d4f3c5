"""Every message of the protocol, declared once in ``host`` or ``device``.

Types are CAN priorities too (``id = type << 4 | node``): the lower, the more urgent, so
stop wins arbitration over everything. Fields may only be appended, and an appended one is
``int | None``: a peer that does not know it leaves it out.
"""

from __future__ import annotations

from protocol.messages import device, host
from protocol.schema.message import declared_in

ALL_MESSAGES = (*declared_in(host), *declared_in(device))
"""The catalogue: each declaration of the two modules."""
