"""Payload bytes to message and back."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

from protocol import primitives
from protocol.errors import FieldRangeError, PayloadError
from protocol.schema.catalogue import CATALOGUE, Catalogue

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.schema.fields import WireType
    from protocol.schema.message import Message, MessageSpec


class Codec:
    """Encodes and decodes a catalogue's messages, as far as a peer agrees with it.

    Where the peer is known to declare other fields of a message, :meth:`limit` says how
    many of ours it shares: fewer of its own arrive (ours beyond them are None), more of its
    own are passed over and counted.
    """

    def __init__(self, catalogue: Catalogue = CATALOGUE) -> None:
        self.catalogue = catalogue
        self.extra_bytes = 0
        """Bytes of fields that only the peer knows, passed over so far."""
        self._shared: dict[int, int] = {}
        self._whole: dict[type[Message], tuple[int, Callable[..., bytes]]] = {
            spec.cls: (spec.type_id, spec.layout.pack) for spec in catalogue if spec.is_numeric
        }
        """What ``struct`` alone can encode, all its fields being sent."""

    def limit(self, type_id: int, shared_fields: int | None) -> None:
        """Note how many leading fields the peer shares; None: exactly ours."""
        spec = self.catalogue.by_type.get(type_id)
        if shared_fields is None:
            self._shared.pop(type_id, None)
            if spec is not None and spec.is_numeric:
                self._whole[spec.cls] = type_id, spec.layout.pack
        else:
            self._shared[type_id] = shared_fields
            if spec is not None:
                self._whole.pop(spec.cls, None)

    def shared_fields(self, spec: MessageSpec) -> int:
        """How many leading fields of ours the peer shares."""
        return self._shared.get(spec.type_id, len(spec.fields))

    def decode(self, spec: MessageSpec, payload: bytes) -> Message:
        """Decode one payload.

        Raises:
            PayloadError: the length is not one that the declaration allows.

        """
        layout = spec.layout
        if len(payload) == layout.size and spec.text_field is None:
            return primitives.make(spec.cls, layout.unpack(payload))
        return self._decode_other(spec, payload)

    def _decode_other(self, spec: MessageSpec, payload: bytes) -> Message:
        count = len(spec.fields)
        shared = self._shared.get(spec.type_id, count)
        layout = spec.layout if shared == count else spec.prefix_layout(shared)
        if len(payload) < layout.size:
            raise PayloadError(spec.name, len(payload), layout.size)
        values: tuple[Any, ...] = layout.unpack_from(payload)
        tail = payload[layout.size :]
        if shared == count and spec.text_field is not None:
            return primitives.make(spec.cls, (*values, tail.decode("utf-8", "replace")))
        if tail:
            if spec.type_id not in self._shared and not spec.bootstrap:
                raise PayloadError(spec.name, len(payload), layout.size)
            self.extra_bytes += len(tail)
        return primitives.make(spec.cls, values + (None,) * (count - len(values)))

    def encode(self, message: Message) -> tuple[int, bytes]:
        """Encode a message: its type and its payload.

        Raises:
            UnknownMessageError: the catalogue does not hold it.
            FieldRangeError: a value does not fit its field.

        """
        try:
            type_id, pack = self._whole[type(message)]
            return type_id, pack(*primitives.values_of(message))
        except (KeyError, struct.error):
            pass  # the slow way knows the others, and which field it was
        spec = self.catalogue.spec(type(message))
        shared = self._shared.get(spec.type_id)
        return spec.type_id, self._encode_other(spec, tuple(message), shared)

    def _encode_other(
        self, spec: MessageSpec, values: tuple[Any, ...], shared: int | None
    ) -> bytes:
        fields, layout = spec.fields, spec.layout
        if shared is not None:
            values, fields, layout = values[:shared], fields[:shared], spec.prefix_layout(shared)
        for field, value in zip(fields, values, strict=True):
            if not _fits(field.wire, value):  # struct cuts and pads bytes without a word
                raise FieldRangeError(spec.name, field.name, value)
        if fields and fields[-1].wire.is_text:
            text: str = values[-1]
            return layout.pack(*values[:-1]) + text.encode("utf-8", "replace")
        return layout.pack(*values)


def _fits(wire: WireType, value: Any) -> bool:  # noqa: ANN401 - whatever the caller put there
    if wire.is_text:
        return isinstance(value, str)
    if wire.is_integer:
        return hasattr(value, "__index__") and bool(wire.low <= value <= wire.high)
    return isinstance(value, bytes) and len(value) == wire.size
