"""Views of a run: Rerun, Foxglove, and reports with pictures."""
