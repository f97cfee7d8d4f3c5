"""A virtual sweeper (robot) that implements the protocol: world, plant, sensors, firmware."""
