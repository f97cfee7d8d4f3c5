"""Coverage planners and what measures them: pure, no clock and no I/O."""
