"""The virtual sweeper's firmware."""
