"""Mechanics and power supply of the virtual sweeper: motors, wheels, contact, battery."""
