"""The ``recovery`` planner: what an obstacle hid is remembered, and gone back for."""
