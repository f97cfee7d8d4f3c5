"""Metrics of a run against the true floor plan; no planner imports this."""
