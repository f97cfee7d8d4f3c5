"""Readings in the units of the C firmware's board interface: see ``board.h``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.messages.values import Contact

if TYPE_CHECKING:
    from sim_device.sensors.contacts import Bumpers

NO_RANGE = 0xFFFF
"""Reading of a ranger if no object is in range."""
_LEFT, _RIGHT, _CLIFF = int(Contact.BUMPER_LEFT), int(Contact.BUMPER_RIGHT), int(Contact.CLIFF)


def contact_bits(bumpers: Bumpers, *, cliff: bool) -> int:
    """Return both bumper switches and the cliff sensor as :class:`Contact` bits."""
    left, right = bumpers
    return (_LEFT if left else 0) | (_RIGHT if right else 0) | (_CLIFF if cliff else 0)


def range_steps(range_m: float | None, per_m: float) -> int:
    """Return a range in steps, with ``per_m`` steps per metre."""
    return NO_RANGE if range_m is None else min(NO_RANGE - 1, max(0, round(range_m * per_m)))


def milli(value: float) -> int:
    """Return volts or amperes as absolute value in thousandths (mV, mA)."""
    return min(0xFFFF, round(1000.0 * abs(value)))
