"""Seeing a run in Rerun, in a process of its own."""
