"""Discovery of devices on a bus that several devices may share."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.clock import HostNs
from protocol.messages.device import Hello

if TYPE_CHECKING:
    from protocol.link import Received

LISTEN_NS = 300_000_000
"""Time to listen before the first hello, ns. Another host sends more than one ping in this time."""
ANSWERS_NS = 300_000_000
"""Time to wait for further hellos after the first, ns. Every device answers a hello at once."""


class Answers:
    """Collects the hellos of all devices, by node and uid, until the waiting time has ended."""

    def __init__(self) -> None:
        self.settled_ns: HostNs | None = None
        self._by_device: dict[tuple[int, bytes], Received] = {}

    def clear(self) -> None:
        """Discard all hellos."""
        self.settled_ns = None
        self._by_device.clear()

    def note(self, hello: Hello, event: Received, opened_ns: int, now_ns: HostNs) -> None:
        """Add one hello. The first hello starts the waiting time."""
        if self.settled_ns is None:
            self.settled_ns = HostNs(max(now_ns, opened_ns + LISTEN_NS) + ANSWERS_NS)
        self._by_device[event.frame.node, hello.uid] = event

    def choose(self) -> tuple[Hello, int] | str:
        """Return the hello and node of the only device, or an error text if there are several."""
        answers = {
            key: event.message
            for key, event in sorted(self._by_device.items())
            if isinstance(event.message, Hello)
        }
        self.clear()
        if len(answers) == 1:
            (((node, _), hello),) = answers.items()
            return hello, node
        named = "; ".join(
            f"node {node}: {hello.name} {hello.version_major}.{hello.version_minor}."
            f"{hello.version_patch}, uid {uid.hex()}"
            for (node, uid), hello in answers.items()
        )
        if len({node for node, _ in answers}) < len(answers):
            return f"several devices answer; two have the same node, give each its own ({named})"
        return f"several devices answer: {named}"
