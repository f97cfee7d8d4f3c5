"""How messages are declared, encoded and compared."""
