"""Several robots at once: a process each, one dashboard, one stop."""
