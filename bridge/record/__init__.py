"""Logs of runs: writing and reading MCAP files."""
