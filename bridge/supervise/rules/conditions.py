"""Interface of a rule's condition."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from bridge.supervise.inputs import RuleInputs, Scalar
    from bridge.supervise.measured import Measured

Evidence = tuple[str, "dict[str, Scalar]"]
"""Finding as text and as data."""


class Condition(Protocol):
    """Condition of one rule.

    :meth:`holds` is called first. It sets the attributes that a class declares without a value.
    :meth:`evidence` reads them.
    """

    grave: bool
    """True if the finding requires the second reaction at once."""

    def holds(self, inputs: RuleInputs, measured: Measured) -> bool:
        """Evaluate a control step; return True if the condition holds."""

    def evidence(self) -> Evidence:
        """Return the finding as text and data. Called only while the condition holds."""

    def restart(self) -> None:
        """Discard the state from before a gap."""
