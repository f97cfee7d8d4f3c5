"""What was heard while no sweeper answered, and what that means."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bridge.session.event_kinds import EventKind
from protocol.link import Medium
from protocol.schema.catalogue import PROTOCOL_VERSION

if TYPE_CHECKING:
    from protocol.link import Rejected

BEGINNING = 512
"""Bytes kept of what comes first: a port server's reason fits."""
_WORDS, _FEW = 200, 8
"""Characters told, and what is too short to be a line of text."""


def words_of(beginning: bytes) -> str | None:
    """The first line of what came, where it is one of text; None where it is not."""
    line, end, _ = beginning.partition(b"\n")
    text = line.strip().decode("ascii", "backslashreplace")
    words = end and line.isascii() and text.isprintable() and len(text) >= _FEW
    return text[:_WORDS] if words else None


@dataclass(slots=True)
class Evidence:
    """Traces on a line on which nobody agreed."""

    received: int = 0
    """Bytes."""
    versions: set[int] = field(default_factory=set)
    """Other protocol versions that intact frames named."""
    nodes: set[int] = field(default_factory=set)
    """Nodes of intact frames from devices, where another one was asked for."""
    echoes: int = 0
    """Messages that only a host sends."""
    beginning: bytes = b""
    """The first bytes: a port server that refuses may say why in words."""

    def hear(self, data: bytes) -> None:
        """Take bytes as they come."""
        self.received += len(data)
        if len(self.beginning) < BEGINNING:
            self.beginning = (self.beginning + data)[:BEGINNING]

    @property
    def words(self) -> str | None:
        """The first line, where it is one of text; None where it is not."""
        return words_of(self.beginning)

    def note(self, event: Rejected) -> None:
        """Take an intact frame that was of no use."""
        if event.reason == "version":
            self.versions.add(event.frame.version)
        elif event.reason == "direction":
            self.echoes += 1

    def verdict(self, medium: Medium, damaged: int) -> tuple[EventKind, str]:
        """Kind of failure and a line for people; ``damaged`` frames were counted by the link."""
        if self.versions:
            spoken = ", ".join(str(v) for v in sorted(self.versions))
            kind = EventKind.VERSION
            text = (
                f"the device speaks protocol version {spoken}, this program "
                f"{PROTOCOL_VERSION}; update the older of the two"
            )
        elif self.echoes and medium is Medium.CAN:
            kind = EventKind.OTHER_HOST
            text = "another host talks on this bus, and a bus has one: end it first"
        elif self.echoes:
            kind = EventKind.ECHO
            text = "our own bytes come back: RX and TX are joined, or echo is on"
        elif self.nodes:
            heard = ", ".join(map(str, sorted(self.nodes)))
            kind = EventKind.OTHER_NODE
            text = (
                f"the node that was asked for does not answer; choose what is heard: node {heard}"
            )
        elif (words := self.words) is not None:
            kind, text = EventKind.WORDS, f"the other end says: {words}"
        elif damaged:
            kind = EventKind.GARBAGE
            text = (
                f"{self.received} bytes came, none of them an intact frame; "
                "check the baud rate, or this is not a sweeper"
            )
        elif self.received:
            kind = EventKind.GARBAGE
            text = f"{self.received} bytes came that are not a sweeper's; check the port"
        else:
            kind = EventKind.SILENCE
            text = "nothing was heard for 3 s; check power, wiring, and that this is the right port"
        return kind, text
