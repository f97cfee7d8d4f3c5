"""Several robots at the same time, with a process for each robot, one dashboard and one stop."""
