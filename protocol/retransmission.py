"""Commands with an id: repeated until they are answered, and executed once.

:class:`CommandSender` is for the end that sends commands, :class:`CommandLog` for the end that
executes them.
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
"""Timeout before the first measured round trip, µs."""
MIN_TIMEOUT_US = 20_000
"""Minimum timeout, µs. It exceeds the 16 ms latency timer of an FTDI adapter; a shorter timeout
would send every command twice."""
MAX_TIMEOUT_US = 1_000_000
"""Maximum timeout, µs, also after doubling."""
STOP_REPEAT_US = 25_000
"""Repetition interval of an unanswered stop, µs; constant, without backoff."""
MAX_TRIES = 6
"""Maximum number of transmissions of a command. The timeout starts at 20 ms or more and doubles, so
all attempts together take more than a second."""
REMEMBERED = 16
"""Number of recent commands whose replies a device stores, to repeat them."""
_HALF = 0x8000
"""Half the range of command ids, which wrap at 16 bits. An id that is less than this behind another
id is older (RFC 1982)."""


class Command(Protocol):
    """A message that carries a command id."""

    @property
    def command_id(self) -> int:
        """Command id, chosen by the sender; the reply contains the same id."""


class RoundTripEstimate:
    """Smoothed round-trip time and the resulting timeout (RFC 6298, section 2)."""

    def __init__(self) -> None:
        self.smoothed_us: float | None = None
        self.variation_us = 0.0

    def add(self, sample_us: float) -> None:
        """Add one measurement, µs."""
        if self.smoothed_us is None:
            self.smoothed_us, self.variation_us = sample_us, sample_us / 2
            return
        self.variation_us += 0.25 * (abs(sample_us - self.smoothed_us) - self.variation_us)
        self.smoothed_us += 0.125 * (sample_us - self.smoothed_us)

    @property
    def timeout_us(self) -> int:
        """Time to wait for a reply before the next transmission, µs."""
        if self.smoothed_us is None:
            return FIRST_TIMEOUT_US
        timeout = self.smoothed_us + max(1_000.0, 4 * self.variation_us)
        return int(min(MAX_TIMEOUT_US, max(MIN_TIMEOUT_US, timeout)))


@dataclass(slots=True)
class Pending:
    """A command that waits for its reply."""

    message: Message
    command_id: int
    type_id: int
    first_us: int
    due_us: int
    tries: int = 0
    forever: bool = False


class Outcome(NamedTuple):
    """Result of a command."""

    message: Message
    accepted: bool
    reason: int | None
    """Reason of the rejection; None if accepted or unanswered."""

    @property
    def timed_out(self) -> bool:
        """True if no reply arrived after the last attempt."""
        return not self.accepted and self.reason is None


class CommandSender:
    """Stores commands until they are answered, and repeats them."""

    def __init__(self, first_id: int = 1) -> None:
        self.round_trip = RoundTripEstimate()
        self._next_id = first_id & 0xFFFF
        self._pending: OrderedDict[int, Pending] = OrderedDict()

    def issue(
        self, make: Callable[[int], Message], type_id: int, now_us: int, *, forever: bool = False
    ) -> int:
        """Create a command with a new id and queue it; return the id.

        With ``forever``, the command is repeated at a constant rate until it is answered. A stop
        uses this.
        """
        command_id = self._next_id
        while command_id in self._pending:  # a stop may still wait when the ids have wrapped
            command_id = (command_id + 1) & 0xFFFF
        self._next_id = (command_id + 1) & 0xFFFF
        self._pending[command_id] = Pending(
            make(command_id), command_id, type_id, now_us, now_us, forever=forever
        )
        return command_id

    def start(
        self, make: Callable[[int], Message], type_id: int, now_us: int, *, forever: bool = False
    ) -> tuple[int, Message]:
        """Start a command that the caller sends now; return its id and message."""
        command_id = self.issue(make, type_id, now_us, forever=forever)
        pending = self._pending[command_id]
        pending.due_us = now_us + self._wait_us(pending)
        pending.tries = 1
        return command_id, pending.message

    def due(self, now_us: int) -> tuple[list[tuple[Message, bool]], list[Outcome]]:
        """Return the messages to send now (True: a retry), and the commands that timed out."""
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
        """Match a reply with its command; return None if no command waits for it."""
        pending = self._pending.get(reply.command_id)
        # A reply to an unsent command belongs to an earlier session's command with the same id.
        if pending is None or not pending.tries or pending.type_id != reply.command_type:
            return None
        del self._pending[reply.command_id]
        if pending.tries == 1:  # Karn's algorithm: a reply after a retry is ambiguous
            self.round_trip.add(now_us - pending.first_us)
        if isinstance(reply, Nack):
            return Outcome(pending.message, accepted=False, reason=reply.reason)
        return Outcome(pending.message, accepted=True, reason=None)

    def withdraw(self, command_id: int) -> None:
        """Remove a command that could not be written."""
        self._pending.pop(command_id, None)

    def next_deadline_us(self) -> int | None:
        """Return the time at which :meth:`due` must be called next, or None."""
        pending = self._pending
        if not pending:  # called in each loop iteration, nearly always empty
            return None
        return min(p.due_us for p in pending.values())

    def cancel(self) -> None:
        """Remove everything at the end of the session."""
        self._pending.clear()

    @property
    def idle(self) -> bool:
        """Whether no command waits for a reply."""
        return not self._pending

    def rests(self, now_us: int) -> bool:
        """Return whether :meth:`due` has nothing to send yet."""
        # Called in each loop iteration, nearly always without a pending command.
        return not self._pending or all(p.due_us > now_us for p in self._pending.values())


class CommandLog:
    """Stores the last replies: a repeated command gets its reply again but is not executed again.

    Ids count up within a session, so each of the last sixteen ids has its own slot. A command with
    an older id may already have been executed, so it is ignored.
    """

    def __init__(self) -> None:
        self._replies: dict[int, tuple[tuple[int, int, int], Ack | Nack]] = {}
        """Replies by slot: the command id modulo ``REMEMBERED``."""
        self._session_id = 0
        self._newest_id = 0

    def once(
        self, session_id: int, type_id: int, command: Message, act: Callable[[], int | None]
    ) -> Ack | Nack | None:
        """Execute a command once and return its reply; a repeated command gets the stored reply.

        ``act`` executes the command; it returns the reason of a rejection, or None. The result is
        None for a command with an id so old that a repeat is not detectable. It gets no reply.
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
        """Replace the stored reply of a command after its result has become known."""
        key = (session_id, reply.command_id, reply.command_type)
        place = reply.command_id % REMEMBERED
        if place in self._replies and self._replies[place][0] == key:
            self._replies[place] = (key, reply)

    def _is_stale(self, session_id: int, command_id: int) -> bool:
        """Return whether an id is older than the last sixteen ids of its session."""
        behind = (self._newest_id - command_id) & 0xFFFF
        if session_id != 0 and session_id == self._session_id and behind < _HALF:
            return behind >= REMEMBERED
        self._session_id, self._newest_id = session_id, command_id
        return False
