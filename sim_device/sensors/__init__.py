"""The virtual sweeper's sensors."""
