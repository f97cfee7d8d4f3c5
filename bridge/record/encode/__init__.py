"""Records as Foxglove and ROS messages."""
