"""Creates a record in the format of ``core/flash_store.h``, with saved parameters and key."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING
from zlib import crc32

from bridge.motion.robot_model import RobotModel
from protocol.authentication import key_words
from protocol.parameter_values import to_raw
from sim_device.device.parameters import table

if TYPE_CHECKING:
    from collections.abc import Mapping

_MAGIC = 0x52415053
_HEAD = struct.Struct("<3I")
_ENTRY = struct.Struct("<2I")
_CHECK = struct.Struct("<I")


def record(values: Mapping[str, int]) -> bytes:
    """Return the record of a first save; ``values`` contains 32-bit values by name."""
    entries = b"".join(_ENTRY.pack(crc32(name.encode()), raw) for name, raw in values.items())
    content = _HEAD.pack(_MAGIC, 0, len(values)) + entries
    return content + _CHECK.pack(crc32(content))


def set_up(model: RobotModel, key: bytes | None) -> dict[str, int]:
    """Return the values to save so that firmware for the default robot runs on this robot."""
    pairs = zip(table(model, 1), table(RobotModel(), 1), strict=True)
    values = {
        own.name: to_raw(own.kind, own.default)
        for own, built in pairs
        if own.default != built.default
    }
    if key is not None:
        values |= {f"authentication {i}": word for i, word in enumerate(key_words(key))}
    return values
