"""Replay of a recorded robot, which answers like a live robot."""
