"""The only package of the host with access to a clock and to ports."""
