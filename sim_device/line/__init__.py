"""The line between the virtual sweeper and its host."""
