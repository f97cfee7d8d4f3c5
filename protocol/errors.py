"""Errors of the protocol, grouped by the end that caused them."""

from __future__ import annotations


class ProtocolError(Exception):
    """Base of every error that this package raises on purpose."""


class LocalError(ProtocolError):
    """Our own program requested something that the protocol cannot represent."""


class FieldRangeError(LocalError):
    """A value does not fit its field."""

    def __init__(self, message: str, field: str, value: object) -> None:
        super().__init__(f"{message}.{field}: {value!r} does not fit")
        self.message = message
        self.field = field
        self.value = value


class UnknownMessageError(LocalError):
    """A message that is not in the catalogue."""

    def __init__(self, message: str) -> None:
        super().__init__(f"{message} is not in the catalogue")
        self.message = message


class RemoteError(ProtocolError):
    """The peer sent invalid data."""


class PayloadError(RemoteError):
    """A payload with a length that does not match the message's declaration."""

    def __init__(self, message: str, length: int, expected: int) -> None:
        super().__init__(f"{message}: payload of {length} B, expected {expected} B")
        self.message = message
        self.length = length
        self.expected = expected
