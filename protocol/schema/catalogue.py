"""The set of messages that one side of a link knows."""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING

from protocol.errors import UnknownMessageError
from protocol.messages import ALL_MESSAGES
from protocol.schema.message import Message, MessageSpec, specify
from protocol.schema.plugged import plugged_messages

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

PROTOCOL_VERSION = 1
"""Of framing and bootstrap messages; everything else is agreed message by message."""


class Catalogue:
    """Messages by type, by name and by class, with their schema hashes."""

    def __init__(self, messages: Iterable[type[Message]]) -> None:
        self.specs: tuple[MessageSpec, ...] = tuple(
            sorted((specify(m) for m in messages), key=lambda s: s.type_id)
        )
        self.by_type: dict[int, MessageSpec] = {s.type_id: s for s in self.specs}
        self.by_class: dict[type[Message], MessageSpec] = {s.cls: s for s in self.specs}
        self.by_name: dict[str, MessageSpec] = {s.name: s for s in self.specs}
        self.chains: dict[int, tuple[int, ...]] = {s.type_id: _chain(s) for s in self.specs}
        whole = "".join(f"{t:02x}:{self.chains[t][-1]:08x}\n" for t in sorted(self.chains))
        self.hash: int = zlib.crc32(whole.encode())

    def __iter__(self) -> Iterator[MessageSpec]:
        return iter(self.specs)

    def spec(self, cls: type[Message]) -> MessageSpec:
        """Specification of a message class.

        Raises:
            UnknownMessageError: the catalogue does not hold it.

        """
        try:
            return self.by_class[cls]
        except KeyError:
            raise UnknownMessageError(cls.__name__) from None


def _chain(spec: MessageSpec) -> tuple[int, ...]:
    """Hash before the first field and after each: equal values mean an equal prefix."""
    values = [zlib.crc32(f"{spec.name}\n".encode())]
    for field in spec.fields:
        values.append(zlib.crc32(f"{field.canonical()}\n".encode(), values[-1]))
    return tuple(values)


CATALOGUE = Catalogue((*ALL_MESSAGES, *plugged_messages(ALL_MESSAGES)))
"""Everything that this version of the project speaks, and the messages of plug-ins."""
