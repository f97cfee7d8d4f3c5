"""A recorded robot that answers like a live one."""
