"""Display of a run in Rerun, in a separate process."""
