"""Who answers on a bus, where several devices may: gathered until it is known to be all."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.clock import HostNs
from protocol.messages import Hello

if TYPE_CHECKING:
    from protocol.link import Received

LISTEN_NS = 300_000_000
"""A host that is there already sends more than one ping in this time."""
ANSWERS_NS = 300_000_000
"""Every device answers the first hello at once: what else there is is heard by then."""


class Answers:
    """Hellos by node and uid, and when everybody has had time to send one."""

    def __init__(self) -> None:
        self.settled_ns: HostNs | None = None
        self._by_device: dict[tuple[int, bytes], Received] = {}

    def clear(self) -> None:
        """Nobody has answered."""
        self.settled_ns = None
        self._by_device.clear()

    def note(self, hello: Hello, event: Received, opened_ns: int, now_ns: HostNs) -> None:
        """Take one answer; the first starts the time."""
        if self.settled_ns is None:
            self.settled_ns = HostNs(max(now_ns, opened_ns + LISTEN_NS) + ANSWERS_NS)
        self._by_device[event.frame.node, hello.uid] = event

    def choose(self) -> tuple[Hello, int] | str:
        """Fetch the one device's hello and node, or what to tell where there are several."""
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
            return f"several devices answer; two of them may not share a node ({named})"
        return f"several devices answer ({named})"
