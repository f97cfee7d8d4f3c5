"""Motion control: legs to velocity setpoints."""
