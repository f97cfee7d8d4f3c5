"""The decoding of bytes that terminals send for keys, as their manuals define them."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tools.live.terminal_keys import Key, KeyDecoder

CASES = [
    # any terminal
    (b"a", [Key("a")]),
    (b"A", [Key("a")]),
    (b" ", [Key("space")]),
    (b"\x1b[A\x1b[D", [Key("up"), Key("left")]),
    (b"\x1bOB", [Key("down")]),  # application mode
    (b"\r", [Key("enter")]),
    (b"\x03", [Key("ctrl+c")]),
    (b"\x7f", [Key("backspace")]),
    ("é".encode(), [Key("é")]),
    # kitty's keyboard protocol: CSI code ; modifiers : event u
    (b"\x1b[97u", [Key("a")]),
    (b"\x1b[97;1:1u", [Key("a")]),
    (b"\x1b[97;1:2u", [Key("a", "repeat")]),
    (b"\x1b[97;1:3u", [Key("a", "release")]),
    (b"\x1b[32;1:3u", [Key("space", "release")]),
    (b"\x1b[27u", [Key("escape")]),
    (b"\x1b[99;5u", [Key("ctrl+c")]),
    (b"\x1b[1;1:3A", [Key("up", "release")]),
    (b"\x1b[1;1:2C", [Key("right", "repeat")]),
    (b"\x1b[97:65;2u", [Key("a")]),  # with shift, and with the shifted key code
    (b"\x1b[57441;2u", []),  # the shift key itself
    # answers, not keys
    (b"\x1b[?11u\x1b[?62;c", []),
]


@pytest.mark.parametrize(("data", "keys"), CASES)
def test_what_it_means(data: bytes, keys: list[Key]) -> None:
    assert KeyDecoder().feed(data) == keys


@pytest.mark.parametrize(("data", "keys"), CASES)
def test_cut_anywhere_it_means_the_same(data: bytes, keys: list[Key]) -> None:
    decoder = KeyDecoder()
    assert [key for byte in data for key in decoder.feed(bytes([byte]))] == keys


def test_a_lone_escape_is_the_key_once_nothing_follows() -> None:
    decoder = KeyDecoder()
    assert decoder.feed(b"\x1b") == []
    assert decoder.waiting
    assert decoder.flush() == [Key("escape")]
    assert not decoder.waiting


def test_a_terminal_reports_whether_it_supports_the_protocol() -> None:
    kitty, xterm = KeyDecoder(), KeyDecoder()
    kitty.feed(b"\x1b[?0u\x1b[?62;52;c")
    xterm.feed(b"\x1b[?64;1;2c")
    assert (kitty.kitty, kitty.answered) == (True, True)
    assert (xterm.kitty, xterm.answered) == (False, True)


@settings(max_examples=80, deadline=None)
@given(st.binary(max_size=60))
def test_any_bytes_are_survived(data: bytes) -> None:
    decoder = KeyDecoder()
    for key in [*decoder.feed(data), *decoder.flush()]:
        assert key.name
        assert key.kind in {"press", "repeat", "release"}
    assert decoder.feed(b"") == []
