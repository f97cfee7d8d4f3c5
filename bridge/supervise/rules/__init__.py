"""Conditions of the supervisor's rules."""
