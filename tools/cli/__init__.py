"""Shared code of the commands: options, console, signals and files."""
