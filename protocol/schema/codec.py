"""Converts payload bytes to messages and back."""

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
    """Encodes and decodes the messages that host and device share.

    If the peer declares fewer or more fields of a message, :meth:`limit` sets the number of fields
    that both ends declare. Missing fields are decoded as None. Additional fields of the peer are
    skipped and their bytes counted.
    """

    def __init__(self, catalogue: Catalogue = CATALOGUE) -> None:
        self.catalogue = catalogue
        self.extra_bytes = 0
        """Number of skipped bytes in fields that only the peer declares."""
        self._shared: dict[int, int] = {}
        self._whole: dict[type[Message], tuple[int, Callable[..., bytes]]] = {
            spec.cls: (spec.type_id, spec.layout.pack) for spec in catalogue if spec.is_numeric
        }
        """Messages that ``struct`` alone can encode: numeric, and with all fields sent."""

    def limit(self, type_id: int, shared_fields: int | None) -> None:
        """Set the number of leading fields that the peer shares; None: exactly our fields."""
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
        """Return the number of our leading fields that the peer shares."""
        return self._shared.get(spec.type_id, len(spec.fields))

    def decode(self, spec: MessageSpec, payload: bytes) -> Message:
        """Decode one payload.

        Raises:
            PayloadError: the declaration does not allow this length.

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
        """Encode a message; return its type and its payload.

        Raises:
            UnknownMessageError: the message is not in the catalogue.
            FieldRangeError: a value does not fit its field.

        """
        try:
            type_id, pack = self._whole[type(message)]
            return type_id, pack(*primitives.values_of(message))
        except (KeyError, struct.error):
            pass  # the slow path handles this message, and reports an invalid field
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
            if not _fits(field.wire, value):  # struct truncates and pads bytes silently
                raise FieldRangeError(spec.name, field.name, value)
        if fields and fields[-1].wire.is_text:
            text: str = values[-1]
            return layout.pack(*values[:-1]) + text.encode("utf-8", "replace")
        return layout.pack(*values)


def _fits(wire: WireType, value: Any) -> bool:  # noqa: ANN401 - any value of the caller
    if wire.is_text:
        return isinstance(value, str)
    if wire.is_integer:
        return hasattr(value, "__index__") and bool(wire.low <= value <= wire.high)
    return isinstance(value, bytes) and len(value) == wire.size
