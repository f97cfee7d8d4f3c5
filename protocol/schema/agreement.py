"""Which messages two ends share, from the chained hashes of their declarations."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from protocol.messages.device import UNKNOWN_MESSAGE, DescribeReply
from protocol.messages.host import Describe
from protocol.schema.message import Direction

if TYPE_CHECKING:
    from protocol.schema.catalogue import Catalogue
    from protocol.schema.message import MessageSpec


class Match(Enum):
    """How a peer's declaration of one message compares with ours."""

    EQUAL = "equal"
    OLDER = "older"
    """The peer lacks our last fields."""
    NEWER = "newer"
    """The peer appended fields that we lack."""
    MISSING = "missing"
    DIFFERENT = "different"


@dataclass(frozen=True, slots=True)
class MessageAgreement:
    """The outcome for one message."""

    spec: MessageSpec
    match: Match
    peer_fields: int

    @property
    def usable(self) -> bool:
        """True where both ends mean the same by what they share."""
        return self.match in {Match.EQUAL, Match.OLDER, Match.NEWER}

    @property
    def shared_fields(self) -> int:
        """Leading fields that both declare."""
        return min(self.peer_fields, len(self.spec.fields)) if self.usable else 0

    def report(self) -> str:
        """One line for people."""
        name = self.spec.name
        names = [f.name for f in self.spec.fields]
        match self.match:
            case Match.EQUAL:
                return f"{name}: equal"
            case Match.OLDER:
                return f"{name}: the device lacks {', '.join(names[self.peer_fields :])}"
            case Match.NEWER:
                extra = self.peer_fields - len(names)
                if self.spec.direction is Direction.HOST:
                    return f"{name}: the device knows {extra} more field(s), not sent to it"
                return f"{name}: the device sends {extra} more field(s), passed over"
            case Match.MISSING:
                return f"{name}: the device does not have it; disabled"
            case Match.DIFFERENT:
                return f"{name}: the device declares other fields; disabled"


def describe(catalogue: Catalogue, question: Describe) -> DescribeReply:
    """A device's answer about one of its messages."""
    spec = catalogue.by_type.get(question.described_type)
    if spec is None:
        return DescribeReply(question.described_type, UNKNOWN_MESSAGE, 0, 0)
    own = len(spec.fields)
    chain = catalogue.chains[spec.type_id][min(question.field_count, own)]
    return DescribeReply(question.described_type, own, spec.layout.size, chain)


class Comparison:
    """Asks about every message and collects the outcome, whatever order answers come in."""

    def __init__(self, catalogue: Catalogue) -> None:
        self._catalogue = catalogue
        self._open = {s.type_id: s for s in catalogue}
        self.outcome: dict[int, MessageAgreement] = {}

    @property
    def complete(self) -> bool:
        """True when every message is settled."""
        return not self._open

    def questions(self, limit: int) -> list[Describe]:
        """Up to ``limit`` questions that are still unanswered."""
        return [Describe(t, len(s.fields)) for t, s in list(self._open.items())[:limit]]

    def answer(self, reply: DescribeReply) -> bool:
        """Take one answer; False for what is settled or was not asked: it is passed over."""
        spec = self._open.pop(reply.described_type, None)
        if spec is None:
            return False
        own = len(spec.fields)
        chains = self._catalogue.chains[spec.type_id]
        if reply.field_count == UNKNOWN_MESSAGE:
            match = Match.MISSING
        elif reply.chain != chains[min(own, reply.field_count)]:
            match = Match.DIFFERENT
        elif reply.field_count < own:
            match = Match.OLDER
        else:
            match = Match.EQUAL if reply.field_count == own else Match.NEWER
        peer = 0 if match is Match.MISSING else reply.field_count
        self.outcome[spec.type_id] = MessageAgreement(spec, match, peer)
        return True
