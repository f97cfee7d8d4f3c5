"""Columns of logged messages: many messages of one shape at once."""
