"""Geometry, kinematics, state estimation and control: pure, no clock and no I/O."""
