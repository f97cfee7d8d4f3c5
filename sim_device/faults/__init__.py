"""Faults that can be injected: their text form, effect and schedule."""
