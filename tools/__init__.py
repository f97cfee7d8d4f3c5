"""The ``sweepctl`` command, and the loop that connects host and virtual robot in virtual time."""
