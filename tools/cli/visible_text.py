"""Escaping of external text, so that it cannot control the terminal or contain hidden characters.

Names, log texts and file names come from devices, files and arguments. A control character in
such a text can move the cursor or write the clipboard. A bidirectional control reorders the
following text. A zero-width character is invisible. Each of these characters becomes a backslash
escape, as in ``repr``.
"""

from __future__ import annotations

import re
import unicodedata

MAX_WORD = 400
"""Maximum length of a word that is not shortened, characters. A path of four long names fits."""
MAX_LINE = 2000
"""Maximum length of a line that is not shortened, characters: about 20 rows of a terminal."""
_HEAD = 80
"""Number of characters at the start of a shortened word or line that are not removed."""
_WORD_TAIL = 40
"""Number of characters at the end of a shortened word that are not removed: paths differ at their
end."""
_LINE_TAIL = 400
"""Number of characters at the end of a shortened line that are not removed: the text after a quoted
value names the error."""
_LONG_WORD = re.compile(rf"\S{{{MAX_WORD + 1},}}")
_INVISIBLE = frozenset("\u034f\u115f\u1160\u17b4\u17b5\u3164\uffa0")
"""Letters and marks without a glyph: Unicode's default ignorable code points that have an ordinary
general category. Variation selectors are not included, because they select a glyph."""


def is_visible(character: str) -> bool:
    """Return whether a character may be printed unescaped."""
    if character in _INVISIBLE:
        return False
    return character.isprintable() or unicodedata.category(character) == "Zs"


def visible(text: str, *, keep: str = "") -> str:
    """Escape every control, bidirectional and invisible character, except those in ``keep``.

    Printable text is returned unchanged.
    """
    bare = text
    for character in keep:
        bare = bare.replace(character, "")
    if bare.isprintable() and _INVISIBLE.isdisjoint(bare):
        return text
    return "".join(c if c in keep or is_visible(c) else _escape(c) for c in text)


def _escape(character: str) -> str:
    if character in _INVISIBLE:
        return f"\\u{ord(character):04x}"
    return repr(character)[1:-1]


def one_line(text: str) -> str:
    """Escape a message, including its line ends, and shorten one that is too long to read."""
    if len(text) <= MAX_WORD and text.isascii() and text.isprintable():
        return text  # nearly every cell of a long table
    return shortened(visible(text))


def shortened(text: str) -> str:
    """Cut the middle out of long words, then out of a long line."""
    line = _LONG_WORD.sub(lambda found: _cut(found[0], _WORD_TAIL), text)
    return line if len(line) <= MAX_LINE else _cut(line, _LINE_TAIL)


def _cut(text: str, tail: int) -> str:
    left_out = len(text) - _HEAD - tail
    return f"{text[:_HEAD]}[... {left_out} characters ...]{text[-tail:]}"
