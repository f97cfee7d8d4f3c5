"""The person beside the robot, as a procedure sees one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.bringup.wiring import Finding


class Person(Protocol):
    """Is told things, and asked."""

    def show(self, text: str) -> None:
        """Read a line."""

    def report(self, finding: Finding) -> None:
        """Read what one look found."""

    def confirm(self, text: str) -> bool:
        """Say yes, before something moves or is written."""

    def choose(self, text: str, answers: Mapping[str, str]) -> str:
        """Give one of the keys of ``answers``, whose values explain them."""

    def number(self, text: str) -> float:
        """Give a number."""
