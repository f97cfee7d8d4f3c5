"""The ``recovery`` planner: it remembers occluded regions and revisits them."""
