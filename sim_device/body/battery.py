"""Battery and logic rail."""

from __future__ import annotations

from dataclasses import dataclass

RAIL_V, RAIL_DROPOUT_V = 5.0, 1.5
"""Voltage and dropout of the logic rail, V. Below a battery voltage of 6.5 V the rail falls with
it."""
RAIL_WHOLE_V = RAIL_V + RAIL_DROPOUT_V
"""Battery voltage from which the logic rail has its full voltage, V."""
BRIDGE_LOGIC_V = 4.5
"""Minimum logic supply of the bridges, V; below it they are off. L298 datasheet, electrical
characteristics."""


@dataclass(frozen=True, slots=True)
class BatteryParameters:
    """A four-cell pack with a protection circuit; ``drive_kernel`` holds its state.

    The open-circuit voltage falls in a straight line with the charge down to the knee. Below the
    knee it falls steeply and the internal resistance grows, so a load pulls the voltage down
    further. At 0 the protection circuit opens: there is no voltage until the pack is charged. The
    terminal voltage is constant over each 10 ms and follows the current of the period before.
    """

    full_v: float = 16.0
    """Open-circuit voltage of the full pack, V."""
    capacity_ah: float = 9.0
    empty_ratio: float = 0.85
    """Open-circuit voltage of the empty pack without the knee, as a share of the full one."""
    resistance_ohm: float = 0.15
    """Resistance of pack, connectors and wiring, Ω."""
    state_of_charge: float = 1.0
    """State of charge at power-on, 0..1."""
    knee: float = 0.05
    """State of charge below which the voltage falls steeply."""
    knee_fall: float = 0.4
    """Share by which the voltage falls below the knee when empty. It leaves 8.2 V, about 2 V a
    cell, where protection circuits open."""
    knee_resistance: float = 4.0
    """Growth of the resistance when empty, as a multiple of the resistance."""


def rail_5v_v(supply_v: float) -> float:
    """Return the logic rail behind its linear regulator (78M05, 1.5 V of dropout)."""
    return max(0.0, min(RAIL_V, supply_v - RAIL_DROPOUT_V))
