"""The catalogue: all messages that one end of a link declares."""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING, NamedTuple

from protocol.errors import UnknownMessageError
from protocol.messages import ALL_MESSAGES
from protocol.schema.message import Message, MessageSpec, specify
from protocol.schema.plugged import plugged_messages

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from enum import IntEnum

PROTOCOL_VERSION = 2
"""Version of framing and bootstrap messages. All other messages are negotiated individually."""


class EnumSpec(NamedTuple):
    """An enumeration that messages use, with its schema hashes."""

    name: str
    enum: type[IntEnum]
    unit: str
    """``enum``: a value is one member; ``bits``: a value is a set of members."""
    members: tuple[str, ...]
    chain: tuple[int, ...]
    """Hash chain. The first hash identifies the enumeration; each further hash includes one more
    member."""

    @property
    def key(self) -> int:
        """Hash of name and kind; it identifies the enumeration in ``describe_enum``."""
        return self.chain[0]


def _specify_enum(enum: type[IntEnum], unit: str) -> EnumSpec:
    members = [(m.name or "").lower() for m in enum]
    values = (f"{name}={int(m)}" for name, m in zip(members, enum, strict=True))
    chain = _chain([f"{enum.__name__}|{unit}", *values])
    return EnumSpec(enum.__name__, enum, unit, tuple(members), chain)


class Catalogue:
    """Messages by type, by name and by class, and their enumerations, with schema hashes."""

    def __init__(self, messages: Iterable[type[Message]]) -> None:
        self.specs: tuple[MessageSpec, ...] = tuple(
            sorted((specify(m) for m in messages), key=lambda s: s.type_id)
        )
        self.by_type: dict[int, MessageSpec] = {s.type_id: s for s in self.specs}
        self.by_class: dict[type[Message], MessageSpec] = {s.cls: s for s in self.specs}
        self.by_name: dict[str, MessageSpec] = {s.name: s for s in self.specs}
        self.chains: dict[int, tuple[int, ...]] = {
            s.type_id: _chain(s.canonical()) for s in self.specs
        }
        named = {f.enum.__name__: (f.enum, f.unit) for s in self.specs for f in s.fields if f.enum}
        enums = [_specify_enum(*named[name]) for name in sorted(named)]
        self.enums: dict[int, EnumSpec] = {e.key: e for e in enums}
        """Enumerations by their key, in the order of their names."""
        self.hash: int = zlib.crc32("".join(f"{line}\n" for line in self._whole()).encode())

    def _whole(self) -> Iterator[str]:
        """Yield the inputs of the catalogue's hash: the last hash of each message and each enum."""
        yield from (f"{t:02x}:{self.chains[t][-1]:08x}" for t in sorted(self.chains))
        yield from (f"{e.key:08x}:{e.chain[-1]:08x}" for e in self.enums.values())

    def __iter__(self) -> Iterator[MessageSpec]:
        return iter(self.specs)

    def spec(self, cls: type[Message]) -> MessageSpec:
        """Return the specification of a message class.

        Raises:
            UnknownMessageError: the message is not in the catalogue.

        """
        try:
            return self.by_class[cls]
        except KeyError:
            raise UnknownMessageError(cls.__name__) from None


def _chain(texts: Iterable[str]) -> tuple[int, ...]:
    """Return the hash after each line; two equal hashes mean that all lines so far are equal."""
    values = [0]
    for text in texts:
        values.append(zlib.crc32(f"{text}\n".encode(), values[-1]))
    return tuple(values[1:])


CATALOGUE = Catalogue((*ALL_MESSAGES, *plugged_messages(ALL_MESSAGES)))
"""All messages of this version of the project and of installed plug-ins."""
