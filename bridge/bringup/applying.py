"""Bringing a calibration to the robot file and to the device, after it was shown and agreed to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bridge.bringup.desk import Desk


@dataclass(frozen=True, slots=True)
class Change:
    """One value that is to be another."""

    parameter: str
    """Its name on the device."""
    key: str
    """Its key in the robot file; of a table with a dot: ``ultrasonic.scale``."""
    unit: str
    old: float
    new: float

    @property
    def line(self) -> str:
        """For people."""
        share = "" if self.old == 0.0 else f" ({100 * (self.new / self.old - 1):+.3f} %)"
        unit = "" if self.unit == "ratio" else f" {self.unit}"
        return f"{self.parameter}: {self.old:.7g} -> {self.new:.7g}{unit}{share}"


@dataclass(frozen=True, slots=True)
class Applied:
    """Where the changes went."""

    set: tuple[str, ...] = ()
    """Parameters set and saved."""
    lacking: tuple[str, ...] = ()
    """Parameters that this device has not."""
    reboot: tuple[str, ...] = ()
    """Of those set, the ones that count from the next boot on."""


def set_on_device(desk: Desk, changes: Sequence[Change]) -> Applied:
    """Set and save; values that the device has no parameter for are named.

    Raises:
        BridgeError: a value does not fit, or the device refused or fell silent.

    """
    known = {p.name: p for p in desk.client.list_parameters()}
    ours = [c for c in changes if c.parameter in known]
    for change in ours:
        known[change.parameter].raw(change.new)  # nothing is changed where one of them cannot be
    late = [
        change.parameter
        for change in ours
        if desk.client.set_parameter(change.parameter, change.new).needs_reboot
    ]
    if ours:
        desk.client.save_parameters()
    lacking = tuple(c.parameter for c in changes if c.parameter not in known)
    return Applied(tuple(c.parameter for c in ours), lacking, tuple(late))
