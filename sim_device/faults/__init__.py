"""Faults to be injected: their texts, what each does, and when."""
