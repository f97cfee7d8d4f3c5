"""Bytes that are not frames: a complete line of printable text is reported, other bytes are not."""

from __future__ import annotations

import pytest

from bridge.session.diagnosis import Evidence
from protocol.link import Medium


@pytest.mark.parametrize(
    ("pieces", "words"),
    [
        ([b"refused: busy\r\n"], "refused: busy"),
        ([b"refu", b"sed: ", b"busy\n", b"\x00\xff"], "refused: busy"),
        ([b"refused: no end"], None),
        ([b"short\n"], None),
        ([b"refused: \x1b[31mbusy\r\n"], None),
        ([b"refused: b\xffsy\r\n"], None),
        ([b"\x00\x10frame frame\n"], None),
        ([b"x" * 600 + b"\n"], None),
        ([b"y" * 300 + b"\n"], "y" * 200),
        ([], None),
    ],
)
def test_words(pieces: list[bytes], words: str | None) -> None:
    evidence = Evidence()
    for piece in pieces:
        evidence.add(piece)
    assert evidence.text_line == words
    assert evidence.received == sum(map(len, pieces))
    kind, text = evidence.verdict(Medium.UART, 0)
    assert (kind == "words") == (words is not None)
    assert words is None or text == f"the peer sent text instead of frames: {words}"
