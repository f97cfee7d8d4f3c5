"""The room around the virtual sweeper: walls, rays, carpets."""
