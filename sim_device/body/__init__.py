"""Mechanics and supply of the virtual sweeper: motors, wheels, contact, battery."""
