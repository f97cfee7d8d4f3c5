"""The virtual sweeper's firmware, in Python."""
