"""Conditions under which the supervisor reacts."""
