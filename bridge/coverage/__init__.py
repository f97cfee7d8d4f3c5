"""Coverage planners: pure, no clock and no I/O."""
