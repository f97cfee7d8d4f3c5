"""The library of recorded runs: an index beside the logs, and selections from it."""
