"""Decoders of logged messages to columns."""
