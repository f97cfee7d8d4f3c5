"""The dashboard of a live run, and its keys."""
