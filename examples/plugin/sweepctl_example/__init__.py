"""Plug-ins for sweepctl: a planner, a message, a fault, a rule and a command."""
