"""Floor plans: walls, obstacles and the start pose."""
