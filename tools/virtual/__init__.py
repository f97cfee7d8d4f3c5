"""Host and virtual sweeper in one process, in virtual time."""
