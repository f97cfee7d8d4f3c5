"""The session with one device. Sans-I/O."""
