"""The live picture of a run, and its keys."""
