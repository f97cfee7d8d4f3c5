"""Floor plans that are made, not read: random rooms, and layouts of the paper."""
