"""Messages over a serial line."""
