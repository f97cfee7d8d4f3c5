"""Commands with an id: retried by the measured round trip, carried out once.

:class:`CommandSender` is the asking end, :class:`CommandLog` the obeying one.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol, cast

from protocol.messages.device import Ack, Nack

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.schema.message import Message

FIRST_TIMEOUT_US = 100_000
MIN_TIMEOUT_US = 20_000
"""Above an FTDI adapter's 16 ms latency timer, or every command would be sent twice."""
MAX_TIMEOUT_US = 1_000_000
STOP_REPEAT_US = 25_000
"""Between two sendings of a stop that nobody has answered yet; it does not back off."""
MAX_TRIES = 6
"""With the timeout doubling from 20 ms this is over a second of trying."""
REMEMBERED = 16
_HALF = 0x8000
"""Ids wrap at 16 bits: one that lies less than this behind another is the older one (RFC 1982)."""


class Command(Protocol):
    """A message that carries a command id."""

    @property
    def command_id(self) -> int:
        """Chosen by the sender, comes back in the reply."""


class RoundTrip:
    """Smoothed round trip and the timeout that follows from it (RFC 6298, section 2)."""

    def __init__(self) -> None:
        self.smoothed_us: float | None = None
        self.variation_us = 0.0

    def add(self, sample_us: float) -> None:
        """Take one measurement."""
        if self.smoothed_us is None:
            self.smoothed_us, self.variation_us = sample_us, sample_us / 2
            return
        self.variation_us += 0.25 * (abs(sample_us - self.smoothed_us) - self.variation_us)
        self.smoothed_us += 0.125 * (sample_us - self.smoothed_us)

    @property
    def timeout_us(self) -> int:
        """How long to wait for a reply before asking again."""
        if self.smoothed_us is None:
            return FIRST_TIMEOUT_US
        timeout = self.smoothed_us + max(1_000.0, 4 * self.variation_us)
        return int(min(MAX_TIMEOUT_US, max(MIN_TIMEOUT_US, timeout)))


@dataclass(slots=True)
class Pending:
    """A command on its way."""

    message: Message
    command_id: int
    type_id: int
    first_us: int
    due_us: int
    tries: int = 0
    forever: bool = False


class Outcome(NamedTuple):
    """How a command ended."""

    message: Message
    accepted: bool
    reason: int | None
    """Of the refusal; None where accepted or where nobody answered."""

    @property
    def timed_out(self) -> bool:
        """True where no reply came after every try."""
        return not self.accepted and self.reason is None


class CommandSender:
    """Keeps commands until they are answered."""

    def __init__(self, first_id: int = 1) -> None:
        self.round_trip = RoundTrip()
        self._next_id = first_id & 0xFFFF
        self._pending: OrderedDict[int, Pending] = OrderedDict()

    def issue(
        self, make: Callable[[int], Message], type_id: int, now_us: int, *, forever: bool = False
    ) -> int:
        """Start a command made from its id; returns the id.

        With ``forever`` it is repeated until answered, however long that takes, at a steady
        pace: stop.
        """
        command_id = self._next_id
        while command_id in self._pending:  # a stop may have waited for a whole turn of the ids
            command_id = (command_id + 1) & 0xFFFF
        self._next_id = (command_id + 1) & 0xFFFF
        self._pending[command_id] = Pending(
            make(command_id), command_id, type_id, now_us, now_us, forever=forever
        )
        return command_id

    def start(
        self, make: Callable[[int], Message], type_id: int, now_us: int, *, forever: bool = False
    ) -> tuple[int, Message]:
        """Start a command whose message the caller writes now; its id, and that message."""
        command_id = self.issue(make, type_id, now_us, forever=forever)
        pending = self._pending[command_id]
        pending.due_us = now_us + self._wait_us(pending)
        pending.tries = 1
        return command_id, pending.message

    def due(self, now_us: int) -> tuple[list[tuple[Message, bool]], list[Outcome]]:
        """Messages to write now, each with whether it is a retry, and what has timed out."""
        messages: list[tuple[Message, bool]] = []
        outcomes: list[Outcome] = []
        for pending in list(self._pending.values()):
            if now_us < pending.due_us:
                continue
            if pending.tries >= MAX_TRIES and not pending.forever:
                del self._pending[pending.command_id]
                outcomes.append(Outcome(pending.message, accepted=False, reason=None))
                continue
            if not pending.tries:
                pending.first_us = now_us
            pending.due_us = now_us + self._wait_us(pending)
            messages.append((pending.message, pending.tries > 0))
            pending.tries += 1
        return messages, outcomes

    def _wait_us(self, pending: Pending) -> int:
        if pending.forever:
            return STOP_REPEAT_US
        return min(MAX_TIMEOUT_US, self.round_trip.timeout_us << min(pending.tries, 5))

    def reply(self, reply: Ack | Nack, now_us: int) -> Outcome | None:
        """Match a reply with its command; None for one that is not awaited."""
        pending = self._pending.get(reply.command_id)
        # A reply to what was not yet sent answers an earlier session's command of the same id.
        if pending is None or not pending.tries or pending.type_id != reply.command_type:
            return None
        del self._pending[reply.command_id]
        if pending.tries == 1:  # Karn: a repeated command's reply cannot be timed
            self.round_trip.add(now_us - pending.first_us)
        if isinstance(reply, Nack):
            return Outcome(pending.message, accepted=False, reason=reply.reason)
        return Outcome(pending.message, accepted=True, reason=None)

    def withdraw(self, command_id: int) -> None:
        """Forget a command that could not be written."""
        self._pending.pop(command_id, None)

    def next_deadline_us(self) -> int | None:
        """When :meth:`due` has work next."""
        pending = self._pending
        if not pending:  # asked at every turn of a loop, and hardly ever with an answer
            return None
        return min(p.due_us for p in pending.values())

    def cancel(self) -> None:
        """Forget everything: the session is over."""
        self._pending.clear()

    @property
    def idle(self) -> bool:
        """True where nothing is awaited."""
        return not self._pending

    def rests(self, now_us: int) -> bool:
        """True where :meth:`due` has no work yet."""
        # Asked at every turn of a loop, and hardly ever is there anything.
        return not self._pending or all(p.due_us > now_us for p in self._pending.values())


class CommandLog:
    """The last replies, so that a repeated command is answered and not carried out again.

    Ids count up within a session, so each has a place of its own among the last sixteen. One that
    is older than those may have been carried out and forgotten: nothing is done for it.
    """

    def __init__(self) -> None:
        self._replies: dict[int, tuple[tuple[int, int, int], Ack | Nack]] = {}
        """By place."""
        self._session_id = 0
        self._newest_id = 0

    def once(
        self, session_id: int, type_id: int, command: Message, act: Callable[[], int | None]
    ) -> Ack | Nack | None:
        """Carry out a command unless it is a repeat; ``act`` gives a refusal's reason or None.

        None: the command is too old to be told from a repeat, and gets no reply.
        """
        command_id = cast("Command", command).command_id
        place, key = command_id % REMEMBERED, (session_id, command_id, type_id)
        known = self._replies.get(place)
        if known is not None and known[0] == key:
            return known[1]
        if self._is_stale(session_id, command_id):
            return None
        reason = act()
        reply = Ack(command_id, type_id) if reason is None else Nack(command_id, type_id, reason)
        self._replies[place] = (key, reply)
        return reply

    def amend(self, session_id: int, reply: Ack | Nack) -> None:
        """Replace the reply of a command whose end is known later than its beginning."""
        key = (session_id, reply.command_id, reply.command_type)
        place = reply.command_id % REMEMBERED
        if place in self._replies and self._replies[place][0] == key:
            self._replies[place] = (key, reply)

    def _is_stale(self, session_id: int, command_id: int) -> bool:
        """Whether an id is older than the last sixteen of its session; session 0 is none."""
        behind = (self._newest_id - command_id) & 0xFFFF
        if session_id != 0 and session_id == self._session_id and behind < _HALF:
            return behind >= REMEMBERED
        self._session_id, self._newest_id = session_id, command_id
        return False
