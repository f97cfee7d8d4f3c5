"""A fleet of robots: stops all of them, ends their processes, and reports the combined result."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from tools.cli.paths import is_there
from tools.fleet.member import LOST_STATUS, Member, drop_line

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tools.fleet.member import OnLine, Target

GRAVITY = (3, 5, 4, 2, 1, 0)
"""Exit statuses from the most severe one to success. The fleet's exit status is the most severe
status of its robots."""
STOP_S = 30.0
"""Maximum time to wait for each robot's stop, s. The limit of the stop itself is shorter."""


class Fleet:
    """Several members; no member can delay another member."""

    def __init__(
        self,
        targets: Sequence[Target],
        arguments: Sequence[str],
        on_line: OnLine = drop_line,
    ) -> None:
        """Create a fleet that is not started; ``arguments`` are options of ``connect``."""
        self._targets, self._arguments, self._on_line = targets, arguments, on_line
        self._ending = False
        """True if an end was requested: no further process starts."""
        self.message = ""
        """Effect of the newest request, for the dashboard."""
        self.stop_requested = False
        self._stopping = threading.Lock()
        self._stoppers: list[threading.Thread] = []
        self.members: list[Member] = []

    def start(self) -> None:
        """Start a process for each robot.

        Raises:
            OSError: a process cannot be started. The others are ended.

        """
        try:
            for target in self._targets:
                if not self._ending:
                    self.members.append(Member(target, self._arguments, self._on_line))
        except BaseException:
            self.end()
            raise

    @property
    def done(self) -> bool:
        """True if every process has ended and every stop has its result."""
        return all(member.ended is not None for member in self.members) and not any(
            thread.is_alive() for thread in self._stoppers
        )

    def end(self) -> None:
        """Request a clean end of every process; does not wait for it."""
        self._ending = True
        self.message = "ending: the robots stop, then the logs are closed"
        for member in self.members:
            member.end()

    def stop(self) -> None:
        """Stop every robot, even if its process has ended; does not wait for the confirmations."""
        with self._stopping:
            if any(thread.is_alive() for thread in self._stoppers):
                return
            self.stop_requested = True
            self.message = "STOP: waiting for every robot to confirm"
            self._stoppers = [
                threading.Thread(target=member.stop, daemon=True) for member in self.members
            ]
            for thread in self._stoppers:
                thread.start()
            threading.Thread(target=self._conclude_stop, daemon=True).start()

    def wait_stopped(self) -> None:
        """Wait until every robot has confirmed its stop, or until the stop has failed."""
        for thread in self._stoppers:
            thread.join(STOP_S)

    @property
    def unconfirmed(self) -> list[str]:
        """Labels of the robots that have not confirmed the stop."""
        if not self.stop_requested:
            return []
        return [
            member.target.label
            for member in self.members
            if member.stopped is None or not member.stopped.confirmed
        ]

    @property
    def exit_status(self) -> int:
        """Most severe exit status of the robots; 3 if a robot did not confirm the stop."""
        statuses = {member.ended.exit_status if member.ended else 1 for member in self.members}
        if self.unconfirmed:
            statuses.add(LOST_STATUS)
        return next((status for status in GRAVITY if status in statuses), 1)

    def to_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {
            "stop_requested": self.stop_requested,
            "unconfirmed": self.unconfirmed,
            "exit_status": self.exit_status,
            "robots": [_member_dict(member) for member in self.members],
        }

    def _conclude_stop(self) -> None:
        self.wait_stopped()
        missing = self.unconfirmed
        if missing:
            self.message = f"NOT CONFIRMED by {', '.join(missing)}: switch these robots off"
        else:
            self.message = "every robot has confirmed the stop"


def _member_dict(member: Member) -> dict[str, Any]:
    ended, stopped, target = member.ended, member.stopped, member.target
    summary = None if ended is None else ended.summary
    return {
        "robot": target.label,
        "port": target.port,
        "outcome": None if ended is None else ended.outcome,
        "reason": None if ended is None else ended.reason,
        "exit_status": None if ended is None else ended.exit_status,
        "stop_confirmed": None if stopped is None else stopped.confirmed,
        "stop_text": None if stopped is None else stopped.text,
        "log": str(target.log) if is_there(target.log) else None,
        "summary": summary,
    }
