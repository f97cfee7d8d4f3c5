"""Planners that others are measured against: the paper's, and two older methods."""
