"""What a rule's condition is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from bridge.supervise.inputs import RuleInputs, Scalar
    from bridge.supervise.measured import Measured

Evidence = tuple[str, "dict[str, Scalar]"]
"""What was found: for people, and as data."""


class Condition(Protocol):
    """One rule's condition.

    A step comes first: what a class declares without a value, ``holds`` sets before anything
    reads it, :meth:`evidence` included.
    """

    grave: bool
    """Whether what is found now asks for the graver reaction at once."""

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Take a step; whether it holds now."""

    def evidence(self) -> Evidence:
        """What was found, in words and as data; asked only while it holds."""

    def restart(self) -> None:
        """Forget what was before a gap."""
