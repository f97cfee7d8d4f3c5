"""The records of an MCAP file, for code that reads or writes them one by one."""

from __future__ import annotations

from io import BytesIO
from typing import TypeVar, cast

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, MessageIndex, Metadata, Schema

__all__ = [
    "Attachment",
    "Channel",
    "Header",
    "MessageIndex",
    "Metadata",
    "Opcode",
    "Schema",
    "parse",
]

_Record = TypeVar("_Record", Attachment, Channel, Header, MessageIndex, Metadata, Schema)


def parse(kind: type[_Record], content: bytes) -> _Record:
    """Read a record's content, which has neither opcode nor length."""
    return cast("_Record", kind.read(ReadDataStream(BytesIO(content))))
