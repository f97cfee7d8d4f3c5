"""What a session knows of its device's declarations, and what follows for its link."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.schema.agreement import Comparison, MessageAgreement

if TYPE_CHECKING:
    from protocol.link import LinkBase
    from protocol.messages import Describe, DescribeReply, Hello
    from protocol.schema.catalogue import Catalogue

QUESTIONS_AT_ONCE = 4


class Agreement:
    """Questions about the messages, until each is agreed or disabled."""

    def __init__(self, catalogue: Catalogue, link: LinkBase) -> None:
        """Nothing is known, and nothing to be asked."""
        self._catalogue = catalogue
        self._link = link
        self._comparison: Comparison | None = None

    @property
    def settled(self) -> bool:
        """True where nothing is left to ask."""
        return self._comparison is None or self._comparison.complete

    @property
    def differences(self) -> tuple[MessageAgreement, ...]:
        """Messages that the device declares otherwise than we do."""
        outcome = self._comparison.outcome.values() if self._comparison else ()
        return tuple(a for a in outcome if a.match.value != "equal")

    def begin(self, hello: Hello) -> None:
        """Start anew with the device that says ``hello``."""
        link = self._link
        for spec in self._catalogue:  # what an earlier agreement said may be wrong now
            link.codec.limit(spec.type_id, None)
        link.disabled.clear()
        same = hello.catalogue_hash == self._catalogue.hash
        self._comparison = None if same else Comparison(self._catalogue)

    def questions(self) -> list[Describe]:
        """What to ask now: the oldest that are unanswered."""
        comparison = self._comparison
        return [] if comparison is None else comparison.questions(QUESTIONS_AT_ONCE)

    def answer(self, reply: DescribeReply) -> bool:
        """Take one answer; False for what was not asked."""
        return self._comparison is not None and self._comparison.answer(reply)

    def apply(self) -> str | None:
        """Set up the link as agreed; what stands in the way, where there is no common ground."""
        outcome = self._comparison.outcome if self._comparison else {}
        # A bootstrap message never changes: one that lacks fields is another message, too.
        broken = [
            a for a in outcome.values() if a.spec.bootstrap and a.shared_fields < len(a.spec.fields)
        ]
        if broken:
            return "; ".join(a.report() for a in broken)
        link = self._link
        for type_id, agreement in outcome.items():
            if agreement.usable:
                shared = agreement.shared_fields
                equal = shared == len(agreement.spec.fields) == agreement.peer_fields
                link.codec.limit(type_id, None if equal else shared)
                link.disabled.discard(type_id)
            else:
                link.disabled.add(type_id)
        return None
