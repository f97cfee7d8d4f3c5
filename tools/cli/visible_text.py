"""Text from outside as a person may see it: nothing in it acts on the terminal or hides.

Names, log texts and file names come from devices, files and arguments. A control character of
theirs moves the cursor or writes the clipboard; a bidirectional control reorders what follows; a
zero-width character hides. Each becomes a backslash escape, as Python's ``repr`` writes it.
"""

from __future__ import annotations

import re
import unicodedata

MAX_WORD = 400
"""Length of a word that is still shown whole, characters. A path of four long names fits."""
MAX_LINE = 2000
"""Length of a line that is still shown whole, characters: some 20 rows of a terminal."""
_HEAD = 80
"""Characters kept of the beginning of what is too long."""
_WORD_TAIL = 40
"""Characters kept of the end of a long word: by its end a path differs from others."""
_LINE_TAIL = 400
"""Characters kept of the end of a long line: what is wrong with a quoted value stands there."""
_LONG_WORD = re.compile(rf"\S{{{MAX_WORD + 1},}}")
_INVISIBLE = frozenset("\u034f\u115f\u1160\u17b4\u17b5\u3164\uffa0")
"""Letters and marks without a shape of their own: Unicode's default ignorable code points that
its general category does not already give away. Variation selectors stay: they choose a shape."""


def is_visible(character: str) -> bool:
    """Whether a character may reach a terminal as it is."""
    if character in _INVISIBLE:
        return False
    return character.isprintable() or unicodedata.category(character) == "Zs"


def visible(text: str, *, keep: str = "") -> str:
    """Escape every character that acts on a terminal, reorders or hides, except those in ``keep``.

    Printable text comes back unchanged.
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
    """Escape a message's text, line ends included, and shorten what is too long to read."""
    return shortened(visible(text))


def shortened(text: str) -> str:
    """Leave out the middle of words, and then of a line, that are too long to read."""
    line = _LONG_WORD.sub(lambda found: _cut(found[0], _WORD_TAIL), text)
    return line if len(line) <= MAX_LINE else _cut(line, _LINE_TAIL)


def _cut(text: str, tail: int) -> str:
    left_out = len(text) - _HEAD - tail
    return f"{text[:_HEAD]}[... {left_out} characters ...]{text[-tail:]}"
