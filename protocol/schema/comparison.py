"""Comparison of the message declarations of both ends by hash chains."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from protocol.messages.device import UNKNOWN, DescribeEnumReply, DescribeReply
from protocol.messages.host import Describe, DescribeEnum
from protocol.schema.message import Direction

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from protocol.schema.catalogue import Catalogue, EnumSpec
    from protocol.schema.message import MessageSpec


class Match(Enum):
    """Result of comparing a peer's declaration of a message or an enumeration with ours."""

    EQUAL = "equal"
    OLDER = "older"
    """The peer does not have our last fields or members."""
    NEWER = "newer"
    """The peer has additional fields or members at the end."""
    MISSING = "missing"
    DIFFERENT = "different"


@dataclass(frozen=True, slots=True)
class EnumComparison:
    """Result of the comparison of one enumeration."""

    spec: EnumSpec
    match: Match
    peer_members: int

    def report(self) -> str:
        """Return the result as one line of text."""
        name, members = self.spec.name, self.spec.members
        match self.match:
            case Match.OLDER:
                return f"{name}: the device lacks {', '.join(members[self.peer_members :])}"
            case Match.NEWER:
                extra = self.peer_members - len(members)
                return f"{name}: the device has {extra} more member(s), which read as unknown"
            case Match.MISSING:
                return f"{name}: the device does not have it"
            case Match.DIFFERENT:
                return f"{name}: the device gives its members other values"
            case _:
                return f"{name}: equal"


@dataclass(frozen=True, slots=True)
class MessageComparison:
    """Result of the comparison of one message."""

    spec: MessageSpec
    match: Match
    peer_fields: int
    enums: tuple[str, ...] = ()
    """Enumerations that the message's shared fields use and that the peer numbers differently."""

    @property
    def usable(self) -> bool:
        """True if the shared fields have the same meaning on both ends."""
        return self.match in {Match.EQUAL, Match.OLDER, Match.NEWER}

    @property
    def shared_fields(self) -> int:
        """Number of leading fields that both ends declare."""
        return min(self.peer_fields, len(self.spec.fields)) if self.usable else 0

    def report(self) -> str:
        """Return the result as one line of text."""
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
                    return f"{name}: the device declares {extra} more field(s), which are not sent"
                return f"{name}: the device sends {extra} more field(s), which are ignored"
            case Match.MISSING:
                return f"{name}: the device does not have it; disabled"
            case Match.DIFFERENT:
                other = f"has other values of {', '.join(self.enums)}"
                what = other if self.enums else "declares other fields"
                return f"{name}: the device {what}; disabled"


Difference = MessageComparison | EnumComparison
Question = Describe | DescribeEnum
Reply = DescribeReply | DescribeEnumReply


def describe(catalogue: Catalogue, question: Question) -> Reply:
    """Return a device's answer about one of its messages or enumerations."""
    if isinstance(question, DescribeEnum):
        enum = catalogue.enums.get(question.enumeration)
        if enum is None:
            return DescribeEnumReply(question.enumeration, UNKNOWN, 0)
        members = len(enum.members)
        chain = enum.chain[min(question.member_count, members)]
        return DescribeEnumReply(question.enumeration, members, chain)
    spec = catalogue.by_type.get(question.described_type)
    if spec is None:
        return DescribeReply(question.described_type, UNKNOWN, 0, 0)
    own = len(spec.fields)
    chain = catalogue.chains[spec.type_id][min(question.field_count, own)]
    return DescribeReply(question.described_type, own, spec.layout.size, chain)


class Comparison:
    """Asks the peer about every message and enumeration; answers may arrive in any order."""

    def __init__(self, catalogue: Catalogue) -> None:
        self._catalogue = catalogue
        self._open: dict[tuple[type[Reply], int], Question] = {
            (DescribeReply, s.type_id): Describe(s.type_id, len(s.fields)) for s in catalogue
        }
        for enum in catalogue.enums.values():
            question = DescribeEnum(enum.key, len(enum.members))
            self._open[DescribeEnumReply, enum.key] = question
        self._messages: dict[int, MessageComparison] = {}
        self._enums: dict[int, EnumComparison] = {}

    @property
    def complete(self) -> bool:
        """True if every question is answered."""
        return not self._open

    @property
    def outcome(self) -> dict[int, MessageComparison]:
        """Return the present result for each message, by type; final once complete."""
        other = {e.spec.name for e in self._enums.values() if e.match is Match.DIFFERENT}
        return {t: _judged(comparison, other) for t, comparison in self._messages.items()}

    @property
    def differences(self) -> tuple[Difference, ...]:
        """Return the messages and enumerations that the peer declares differently."""
        found: Iterator[Difference] = iter([*self.outcome.values(), *self._enums.values()])
        return tuple(d for d in found if d.match is not Match.EQUAL)

    def questions(self, limit: int) -> list[Question]:
        """Return up to ``limit`` unanswered questions."""
        return list(self._open.values())[:limit]

    def answer(self, reply: Reply) -> bool:
        """Process one answer; ignore a repeated or unexpected answer and return False."""
        if isinstance(reply, DescribeEnumReply):
            if self._open.pop((DescribeEnumReply, reply.enumeration), None) is None:
                return False
            enum, count = self._catalogue.enums[reply.enumeration], reply.member_count
            match = _match(enum.chain, count, reply.chain)
            self._enums[enum.key] = EnumComparison(enum, match, 0 if count == UNKNOWN else count)
            return True
        if self._open.pop((DescribeReply, reply.described_type), None) is None:
            return False
        spec, count = self._catalogue.by_type[reply.described_type], reply.field_count
        match = _match(self._catalogue.chains[spec.type_id], count, reply.chain)
        peer = 0 if count == UNKNOWN else count
        self._messages[spec.type_id] = MessageComparison(spec, match, peer)
        return True


def _match(chain: Sequence[int], peer_count: int, peer_chain: int) -> Match:
    own = len(chain) - 1
    if peer_count == UNKNOWN:
        return Match.MISSING
    if peer_chain != chain[min(own, peer_count)]:
        return Match.DIFFERENT
    if peer_count < own:
        return Match.OLDER
    return Match.EQUAL if peer_count == own else Match.NEWER


def _judged(comparison: MessageComparison, other_enums: set[str]) -> MessageComparison:
    """Mark a message as different if its shared fields use a differing enumeration."""
    shared = comparison.spec.fields[: comparison.shared_fields]
    used = {f.enum.__name__ for f in shared if f.enum is not None} & other_enums
    if not used:
        return comparison
    named = tuple(sorted(used))
    return MessageComparison(comparison.spec, Match.DIFFERENT, comparison.peer_fields, named)
