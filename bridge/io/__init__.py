"""The host's only place with a clock and a port."""
