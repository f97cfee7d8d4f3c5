"""Logs into other forms: tables, recovered files, logs of captures."""
