"""The ``sweepctl`` command and what joins host and virtual sweeper."""
