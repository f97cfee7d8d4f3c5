"""Tools for developers: generated pages, sizes, the demo."""
