"""Messages over classic CAN."""
