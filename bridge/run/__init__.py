"""One robot's run, sans-I/O: state, mission, supervision and summary."""
