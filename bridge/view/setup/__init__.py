"""Pictures of a run's initial conditions: robot and room."""
