"""Generated parts of handwritten pages, between two comments."""

from __future__ import annotations


def with_part(page: str, name: str, part: str) -> str:
    """Return a page with this text between its comments ``name: begin`` and ``name: end``.

    Raises:
        ValueError: the page lacks one of the comments.

    """
    before, begin, rest = page.partition(f"<!-- {name}: begin -->\n")
    _, end, after = rest.partition(f"<!-- {name}: end -->\n")
    if not begin or not end:
        raise ValueError(f"the page has no place for {name}")
    return f"{before}{begin}{part}{end}{after}"
