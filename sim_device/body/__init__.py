"""The virtual sweeper's body: motors, wheels, contact and supply."""
