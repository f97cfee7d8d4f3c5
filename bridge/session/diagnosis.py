"""Diagnosis of a failed handshake from the traffic received."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bridge.session.event_kinds import EventKind
from protocol.link import Medium
from protocol.schema.catalogue import PROTOCOL_VERSION

if TYPE_CHECKING:
    from protocol.link import Rejected

BEGINNING = 512
"""Number of first bytes that are stored. They can contain a port server's rejection text."""
_WORDS = 200
"""Maximum number of characters of received text that a message quotes."""
_FEW = 8
"""Minimum length of a text line, characters. Shorter lines occur in noise by chance."""


def text_line(beginning: bytes) -> str | None:
    """Return the first received line if it is readable text, else None."""
    line, end, _ = beginning.partition(b"\n")
    text = line.strip().decode("ascii", "backslashreplace")
    readable = end and line.isascii() and text.isprintable() and len(text) >= _FEW
    return text[:_WORDS] if readable else None


@dataclass(slots=True)
class Evidence:
    """Counts and samples of the traffic received before the handshake."""

    received: int = 0
    """Number of bytes received."""
    versions: set[int] = field(default_factory=set)
    """Other protocol versions found in intact frames."""
    nodes: set[int] = field(default_factory=set)
    """Nodes other than the requested node that sent intact frames."""
    echoes: int = 0
    """Number of received messages that only a host sends."""
    beginning: bytes = b""
    """First bytes received. A port server that rejects the connection may send its reason as
    text."""

    def add(self, data: bytes) -> None:
        """Add received bytes."""
        self.received += len(data)
        if len(self.beginning) < BEGINNING:
            self.beginning = (self.beginning + data)[:BEGINNING]

    @property
    def text_line(self) -> str | None:
        """First received line if it is readable text, else None."""
        return text_line(self.beginning)

    def note(self, event: Rejected) -> None:
        """Count an intact frame that the link rejected."""
        if event.reason == "version":
            self.versions.add(event.frame.version)
        elif event.reason == "direction":
            self.echoes += 1

    def verdict(self, medium: Medium, damaged: int) -> tuple[EventKind, str]:
        """Return the kind of failure and its text; ``damaged`` counts the bad frames."""
        if self.versions:
            versions = ", ".join(str(v) for v in sorted(self.versions))
            kind = EventKind.VERSION
            text = (
                f"the device uses protocol version {versions}, this program uses "
                f"{PROTOCOL_VERSION}; update the older of the two"
            )
        elif self.echoes and medium is Medium.CAN:
            kind = EventKind.OTHER_HOST
            text = "another host sends on this bus, which allows one host; stop the other host"
        elif self.echoes:
            kind = EventKind.ECHO
            text = "the host receives its own bytes; check RX and TX for a short, or turn echo off"
        elif self.nodes:
            nodes = ", ".join(map(str, sorted(self.nodes)))
            kind = EventKind.OTHER_NODE
            text = f"the requested node does not answer; use a node that was received: node {nodes}"
        elif (text_line := self.text_line) is not None:
            kind, text = EventKind.WORDS, f"the peer sent text instead of frames: {text_line}"
        elif damaged:
            kind = EventKind.GARBAGE
            text = (
                f"received {self.received} bytes but no intact frame; "
                "check the baud rate and that this port is the robot's"
            )
        elif self.received:
            kind = EventKind.GARBAGE
            text = f"received {self.received} bytes that are not from a robot; check the port"
        else:
            kind = EventKind.SILENCE
            text = "nothing received for 3 s; check the power, the wiring and the port name"
        return kind, text
