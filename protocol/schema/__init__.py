"""Declaration, encoding and comparison of messages."""
