"""Writing of a confirmed calibration to the device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bridge.bringup.session import BringupSession


@dataclass(frozen=True, slots=True)
class Change:
    """The change of one value."""

    parameter: str
    """Name of the device's parameter."""
    key: str
    """Key in the robot file. A key in a table has a dot, as in ``ultrasonic.scale``."""
    unit: str
    old: float
    new: float

    @property
    def line(self) -> str:
        """Return the change as a line for people."""
        share = "" if self.old == 0.0 else f" ({100 * (self.new / self.old - 1):+.3f} %)"
        unit = "" if self.unit == "ratio" else f" {self.unit}"
        return f"{self.parameter}: {self.old:.7g} -> {self.new:.7g}{unit}{share}"


@dataclass(frozen=True, slots=True)
class Applied:
    """The changes that were written to the device."""

    set: tuple[str, ...] = ()
    """Parameters that were set and saved."""
    lacking: tuple[str, ...] = ()
    """Parameters that this device does not have."""
    reboot: tuple[str, ...] = ()
    """Parameters among ``set`` that take effect at the next boot."""


def set_on_device(session: BringupSession, changes: Sequence[Change]) -> Applied:
    """Set and save the parameters. Return the names that were set, and those the device lacks.

    Raises:
        BridgeError: a value is out of range, or the device rejected it or was lost.

    """
    known = {p.name: p for p in session.client.list_parameters()}
    ours = [c for c in changes if c.parameter in known]
    for change in ours:
        known[change.parameter].raw(change.new)  # if one value is invalid, none is changed
    late = [
        change.parameter
        for change in ours
        if session.client.set_parameter(change.parameter, change.new).needs_reboot
    ]
    if ours:
        session.client.save_parameters()
    lacking = tuple(c.parameter for c in changes if c.parameter not in known)
    return Applied(tuple(c.parameter for c in ours), lacking, tuple(late))
