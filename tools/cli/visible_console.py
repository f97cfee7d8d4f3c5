"""Rich's console, for text from outside: no markup, no emoji codes, nothing that acts."""

from __future__ import annotations

import os
import re
from itertools import accumulate
from typing import TYPE_CHECKING

from rich.console import Console, ConsoleDimensions
from rich.protocol import rich_cast
from rich.segment import Segment
from rich.text import Span, Text

from tools.cli.visible_text import visible

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.console import ConsoleOptions, RenderableType

_SIZES = frozenset({"COLUMNS", "LINES", "JUPYTER_COLUMNS", "JUPYTER_LINES"})
"""Variables from which Rich takes the size of a terminal."""
_SIZE = re.compile("[1-9][0-9]*")
_MAX_DIGITS = 6
"""Digits of a size that are read: more are more than any screen has."""
_KEPT = "\n\t"
"""Characters that Rich lays out itself: line ends, and tabs."""
MAX_COLUMNS, MAX_ROWS = 500, 200
"""Size up to which a window is filled, characters. A screen of 3840 pixels has some 480 by 140. A
terminal may report 65 535 by 65 535, of which one picture has 4 GB."""


class VisibleConsole(Console):
    """A console that escapes what is not visible, wherever it comes to it: text, table, picture."""

    def __init__(self, *, stderr: bool = False) -> None:
        """Write to stdout, or to stderr."""
        super().__init__(
            stderr=stderr, highlight=False, markup=False, emoji=False, _environ=_environment()
        )

    @property
    def size(self) -> ConsoleDimensions:
        """Size of the terminal, as far as it is filled."""
        size = super().size
        return ConsoleDimensions(min(size.width, MAX_COLUMNS), min(size.height, MAX_ROWS))

    @size.setter
    def size(self, new_size: tuple[int, int]) -> None:
        """Lay out for another size than the terminal's."""
        self.width, self.height = new_size

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Render as Rich does, text made visible before it is laid out."""
        cast = rich_cast(renderable)
        if isinstance(cast, str):
            cast = Text(visible(cast, keep=_KEPT))
        elif isinstance(cast, Text):
            cast = _visible(cast)
        for segment in super().render(cast, options):
            # What Rich sends to the terminal on its own account is a control segment.
            if segment.control is None and not segment.text.isprintable():
                yield Segment(visible(segment.text, keep="\n"), segment.style)
            else:
                yield segment


def _environment() -> dict[str, str]:
    """The environment, without sizes that are no numbers.

    Rich takes every digit of Unicode for one of a number: ``²`` would be an error in it.
    """
    return {
        name: value[:_MAX_DIGITS] if name in _SIZES else value
        for name, value in os.environ.items()
        if name not in _SIZES or _SIZE.fullmatch(value)
    }


def _visible(text: Text) -> Text:
    """Give a text with its escapes, styled as it was."""
    plain = visible(text.plain, keep=_KEPT)
    if plain == text.plain:
        return text
    shown = [visible(character, keep=_KEPT) for character in text.plain]
    at = list(accumulate(map(len, shown), initial=0))
    end = len(shown)
    spans = [Span(at[s.start], at[min(s.end, end)], s.style) for s in text.spans]
    return Text(
        plain,
        text.style,
        justify=text.justify,
        overflow=text.overflow,
        no_wrap=text.no_wrap,
        end=text.end,
        tab_size=text.tab_size,
        spans=spans,
    )
