"""The conversation with one device, sans-I/O."""
