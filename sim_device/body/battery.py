"""Battery and logic rail."""

from __future__ import annotations

from dataclasses import dataclass

RAIL_V, RAIL_DROPOUT_V = 5.0, 1.5
"""Voltage and dropout of the logic rail, V. Below 6.5 V of battery voltage, the rail voltage falls
with the battery voltage."""
RAIL_WHOLE_V = RAIL_V + RAIL_DROPOUT_V
"""Minimum battery voltage for the full voltage of the logic rail, V."""
BRIDGE_LOGIC_V = 4.5
"""Minimum logic supply of the motor bridges, V (L298 datasheet, electrical characteristics). Below
it the bridges are off."""


@dataclass(frozen=True, slots=True)
class BatteryParameters:
    """A four-cell pack with a protection circuit; ``drive_kernel`` holds its state.

    The open-circuit voltage falls in a straight line with the charge down to the knee. Below the
    knee it falls steeply and the internal resistance grows, so a load pulls the voltage down
    further. At 0 the protection circuit opens: there is no voltage until the pack is charged. The
    terminal voltage is constant over each period of 10 ms; it depends on the current of the
    previous period.
    """

    full_v: float = 16.0
    """Open-circuit voltage of the full pack, V."""
    capacity_ah: float = 9.0
    empty_ratio: float = 0.85
    """Open-circuit voltage of the empty pack without the knee, as a share of ``full_v``."""
    resistance_ohm: float = 0.15
    """Resistance of pack, connectors and wiring, Ω."""
    state_of_charge: float = 1.0
    """State of charge at power-on, 0..1."""
    knee: float = 0.05
    """State of charge below which the voltage falls steeply."""
    knee_fall: float = 0.4
    """Additional drop of the empty pack's voltage below the knee, as a share. It leaves 8.2 V,
    about 2 V per cell; protection circuits open at this voltage."""
    knee_resistance: float = 4.0
    """Increase of the empty pack's resistance, as a multiple of ``resistance_ohm``."""


def rail_5v_v(supply_v: float) -> float:
    """Return the voltage of the logic rail after its linear regulator (78M05, 1.5 V of dropout)."""
    return max(0.0, min(RAIL_V, supply_v - RAIL_DROPOUT_V))
