"""Pictures of the initial conditions of a run: the robot and the room."""
