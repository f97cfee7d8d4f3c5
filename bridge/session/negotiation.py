"""Schema negotiation: compares the device's message declarations with the host's."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.schema.comparison import Comparison

if TYPE_CHECKING:
    from protocol.link import LinkBase
    from protocol.messages.device import Hello
    from protocol.schema.catalogue import Catalogue
    from protocol.schema.comparison import Difference, Question, Reply

QUESTIONS_AT_ONCE = 4
"""Maximum number of questions that wait for a reply at the same time."""


class SchemaNegotiation:
    """Asks the device for its message declarations and sets up the link accordingly."""

    def __init__(self, catalogue: Catalogue, link: LinkBase) -> None:
        """Create an idle negotiation; :meth:`begin` starts it."""
        self._catalogue = catalogue
        self._link = link
        self._comparison: Comparison | None = None

    @property
    def settled(self) -> bool:
        """True if no question is open."""
        return self._comparison is None or self._comparison.complete

    @property
    def differences(self) -> tuple[Difference, ...]:
        """Messages and enumerations that the device declares differently from the host."""
        return self._comparison.differences if self._comparison else ()

    def begin(self, hello: Hello) -> None:
        """Start a negotiation with the device that sent ``hello``."""
        link = self._link
        for spec in self._catalogue:  # undo an earlier negotiation
            link.codec.limit(spec.type_id, None)
        link.disabled.clear()
        same = hello.catalogue_hash == self._catalogue.hash
        self._comparison = None if same else Comparison(self._catalogue)

    def questions(self) -> list[Question]:
        """Return the oldest unanswered questions, at most :data:`QUESTIONS_AT_ONCE`."""
        comparison = self._comparison
        return [] if comparison is None else comparison.questions(QUESTIONS_AT_ONCE)

    def answer(self, reply: Reply) -> bool:
        """Handle a reply. Return False if the reply belongs to no question."""
        return self._comparison is not None and self._comparison.answer(reply)

    def apply(self) -> str | None:
        """Set up the link. Return the reason as text if host and device are incompatible."""
        outcome = self._comparison.outcome if self._comparison else {}
        # A bootstrap message never changes, so a bootstrap message with fewer fields is an error.
        broken = [
            a for a in outcome.values() if a.spec.bootstrap and a.shared_fields < len(a.spec.fields)
        ]
        if broken:
            return "; ".join(a.report() for a in broken)
        link = self._link
        for type_id, comparison in outcome.items():
            if comparison.usable:
                shared = comparison.shared_fields
                equal = shared == len(comparison.spec.fields) == comparison.peer_fields
                link.codec.limit(type_id, None if equal else shared)
                link.disabled.discard(type_id)
            else:
                link.disabled.add(type_id)
        return None
