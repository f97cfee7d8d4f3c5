"""A virtual sweeper that speaks the wire protocol: world, plant, sensors, firmware."""
