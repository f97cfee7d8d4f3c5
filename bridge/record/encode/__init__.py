"""Encoders of records as Foxglove and ROS messages."""
