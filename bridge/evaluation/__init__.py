"""Metrics of a run by the true floor plan; planners do not import this package."""
