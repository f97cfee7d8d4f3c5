"""Interface between a procedure and the person beside the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.bringup.wiring import CheckResult


class Person(Protocol):
    """Shows lines to the person and asks questions."""

    def show(self, text: str) -> None:
        """Show a line."""

    def report(self, finding: CheckResult) -> None:
        """Show a finding."""

    def confirm(self, text: str) -> bool:
        """Ask for permission before something moves or is written."""

    def choose(self, text: str, answers: Mapping[str, str]) -> str:
        """Ask for one of the keys of ``answers``; the values explain the keys."""

    def number(self, text: str) -> float:
        """Ask for a number."""
