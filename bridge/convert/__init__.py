"""Conversion of logs: tables, recovered files, logs from captures."""
