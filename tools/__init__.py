"""The ``sweepctl`` command, and the loop that joins host and virtual sweeper."""
