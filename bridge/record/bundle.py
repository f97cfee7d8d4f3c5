"""Messages of fixed length that always come together, as one ``struct.pack``."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

from bridge.record.chunked import MESSAGE_FIXED, OP_MESSAGE, RECORD_HEAD
from bridge.record.packer import Packer, Part

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from bridge.record.chunked import ChunkedFile

_MESSAGE_HEAD = struct.Struct("<BQH")


class Bundle:
    """Messages of fixed length that always come together, packed in one go.

    Of every message the values are: sequence, log time and publish time (ns), then those of
    its own form.
    """

    def __init__(self, file: ChunkedFile, messages: Iterable[tuple[int, Sequence[Part]]]) -> None:
        """Take a channel's id and a form for each message."""
        parts: list[Part] = []
        places: list[tuple[int, int]] = []
        offset = 0
        for channel_id, form in messages:
            size = MESSAGE_FIXED + Packer(form).size
            parts += (_MESSAGE_HEAD.pack(OP_MESSAGE, size, channel_id), "I", "Q", "Q", *form)
            places.append((channel_id, offset))
            offset += RECORD_HEAD + size
        packer = Packer(parts)
        self._template, self._form = packer.template, packer.form
        self._add = file.add_records
        self._entries = file.join(tuple(places))

    def add(self, log_ns: int, values: Iterable[Any]) -> None:
        """Write the messages; ``log_ns`` must be the log time that the values name.

        Raises:
            LogWriteError: the file cannot be written.

        """
        parts = self._template.copy()  # Packer.pack, without the call
        parts[1::2] = values
        self._add(log_ns, self._form(*parts), self._entries)
