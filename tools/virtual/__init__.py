"""Host and virtual sweeper in one process, in virtual time; and an emulator as a process."""
