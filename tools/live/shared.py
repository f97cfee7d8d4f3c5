"""Dashboard for a run that another process owns.

The owner shares the data; the view displays them.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

from bridge.api.owner_view import read_model, read_snapshot
from bridge.errors import BridgeError, NoOwnerError
from bridge.floor_plan.floor_plan import parse_floorplan
from bridge.io import clock
from bridge.io.owner_client import ask, watch
from bridge.record.sink import NullSink
from bridge.session.records import Severity
from tools.live.heading import RunFacts
from tools.live.live import EventLines

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bridge.floor_plan.floor_plan import FloorPlan

_SHARED_LINES = 20
"""Number of newest event lines that are shared: more than a dashboard shows."""


class SharedPage:
    """Data that a run shares in addition to the state of its robot."""

    def __init__(self, events: EventLines, facts: RunFacts) -> None:
        """Share the lines of ``events`` and the facts of the run."""
        self._events, self._facts = events, facts

    def about(self) -> dict[str, Any]:
        """Return the data that is sent once, at the start, for JSON."""
        facts = self._facts
        return {
            "log": facts.log,
            "viewer": facts.page,
            "planner": facts.planner,
            "room": None if facts.plan is None else facts.plan.to_json(),
            "elapsed_s": None if facts.began_ns is None else (clock.now() - facts.began_ns) / 1e9,
            "path": [[x_m, y_m] for x_m, y_m in facts.trail.copy()],
        }

    def news(self) -> dict[str, Any]:
        """Return the newest events and the coverage, for JSON."""
        lines, coverage = list(self._events.lines)[-_SHARED_LINES:], self._facts.coverage
        return {
            "events": [[severity.value, text] for severity, text in lines],
            "coverage": None if coverage is None else coverage.share(clock.now() / 1e9),
        }


class ReportedCoverage:
    """The coverage that an owner reports."""

    def __init__(self) -> None:
        """Begin without a reported coverage."""
        self.newest = 0.0

    def share(self, now_s: float) -> float:  # noqa: ARG002 - the interface of a coverage
        """Return the newest share, 0 to 1."""
        return self.newest


class OwnerPicture:
    """The newest state of a run that another process owns."""

    def __init__(self, port: str, hz: float) -> None:
        """Connect to the owner of ``port``, and wait for the first state.

        Raises:
            NoOwnerError: the port has no owner, or the owner has another version of sweepctl.
            OwnerRejectedError: the owner does not support the request.

        """
        about: dict[str, Any] = ask(port, {"do": "about"})["about"]
        self._model = read_model(about)
        self._coverage = ReportedCoverage()
        self._states = watch(port, hz=hz, of="dashboard")
        self.events = EventLines(NullSink(), plain=False)
        try:
            self.facts = RunFacts(
                port,
                str(about.get("log", "")),
                str(about.get("viewer", "")),
                str(about.get("planner", "")),
                _room(about.get("room")),
                note="another process has the port; this command only shows its run",
            )
            elapsed_s = about.get("elapsed_s")
            if elapsed_s is not None:
                self.facts.began_ns = clock.now() - round(elapsed_s * 1e9)
            self.facts.trail.extend((x_m, y_m) for x_m, y_m in about.get("path", ()))
            self._take(next(self._states))
        except StopIteration:
            raise NoOwnerError(f"the owner of {port} has ended") from None
        except (TypeError, ValueError, BridgeError) as error:
            text = f"the owner of {port} is another version of sweepctl ({error})"
            raise NoOwnerError(text) from None

    def follow(self) -> Iterator[None]:
        """Read each new state, until the owner ends."""
        yield
        for data in self._states:
            self._take(data)
            yield

    def _take(self, data: dict[str, Any]) -> None:
        self.snapshot = read_snapshot(data, self._model, clock.now() / 1e9)
        lines = [(Severity(severity), str(text)) for severity, text in data["events"]]
        self.events.lines = deque(lines)
        if data["coverage"] is not None:
            self._coverage.newest = float(data["coverage"])
            self.facts.coverage = self._coverage


def _room(text: str | None) -> FloorPlan | None:
    return None if text is None else parse_floorplan(text)
