"""Rich's console for text from outside: no markup, no emoji codes, no control characters."""

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
"""Environment variables from which Rich reads the size of a terminal."""
_SIZE = re.compile("[1-9][0-9]*")
_MAX_DIGITS = 6
"""Number of digits that are read of the size of a terminal. A real size has fewer digits."""
_KEPT = "\n\t"
"""Characters that are not escaped, because Rich handles them: line ends and tabs."""
MAX_COLUMNS, MAX_ROWS = 500, 200
"""Maximum size of the drawn area, characters. A screen of 3840 pixels has about 480 by 140. A
terminal may report 65 535 by 65 535: one screen would then take 4 GB."""


class VisibleConsole(Console):
    """A console that escapes control and invisible characters in texts, tables and displays."""

    def __init__(self, *, stderr: bool = False) -> None:
        """Write to stdout, or with ``stderr`` to stderr."""
        super().__init__(
            stderr=stderr, highlight=False, markup=False, emoji=False, _environ=_environment()
        )

    @property
    def size(self) -> ConsoleDimensions:
        """Size of the terminal, at most ``MAX_COLUMNS`` by ``MAX_ROWS``."""
        size = super().size
        return ConsoleDimensions(min(size.width, MAX_COLUMNS), min(size.height, MAX_ROWS))

    @size.setter
    def size(self, new_size: tuple[int, int]) -> None:
        """Set a size that replaces the size of the terminal."""
        self.width, self.height = new_size

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Render as Rich does, with text escaped before it is laid out."""
        cast = rich_cast(renderable)
        if isinstance(cast, str):
            cast = Text(visible(cast, keep=_KEPT))
        elif isinstance(cast, Text):
            cast = _visible(cast)
        for segment in super().render(cast, options):
            # Rich's own terminal sequences are control segments; they are not escaped.
            if segment.control is None and not segment.text.isprintable():
                yield Segment(visible(segment.text, keep="\n"), segment.style)
            else:
                yield segment


def _environment() -> dict[str, str]:
    """Return the environment without invalid terminal sizes.

    Rich tests them with ``str.isdigit``, which accepts ``²``, and then fails in ``int``.
    """
    return {
        name: value[:_MAX_DIGITS] if name in _SIZES else value
        for name, value in os.environ.items()
        if name not in _SIZES or _SIZE.fullmatch(value)
    }


def _visible(text: Text) -> Text:
    """Return the text with escapes; each character and its escape have the same style."""
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
