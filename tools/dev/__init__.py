"""Tools for developers: generated pages, firmware sizes, the demo, checks."""
