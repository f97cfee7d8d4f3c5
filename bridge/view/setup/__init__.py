"""Pictures of what a run starts from: the robot and the room."""
