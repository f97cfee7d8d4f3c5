"""The images docs/images/pins-*.png show every pin of the firmware's boards once."""

from __future__ import annotations

import io
import re

import pytest
from matplotlib.image import imread

from bridge.view.report.drawing import as_png
from support.root import ROOT
from tools.dev.pin_pictures import (
    BOARDS,
    FIRMWARE,
    FIXED,
    ORDER,
    TITLES,
    connectors,
    draw,
    wires,
)

PINS = re.compile(r"\bP[A-G]\d+\b")


@pytest.mark.parametrize("board", BOARDS.values())
def test_every_pin_of_the_headers_is_drawn_once(board: str) -> None:
    connected = wires(board)
    config = (FIRMWARE / board / "board_config.h").read_text("utf-8")
    in_config = {f"P{port}{pin}" for port, pin in re.findall(r"PORT_([A-G]), (\d+)", config)}
    pins = [wire.pin for wire in connected]
    assert len(pins) == len(set(pins))
    assert set(pins) == in_config | {wire.pin for wire in FIXED}
    assert [part for part in ORDER if part in {wire.part for wire in connected}] == list(ORDER)


def test_the_fixed_pins_are_those_of_the_shared_header() -> None:
    header = (FIRMWARE / "stm32f429" / "f429.h").read_text("utf-8")
    comment = header.partition("*/")[0]
    assert {wire.pin for wire in FIXED} == set(PINS.findall(comment))


def test_the_nucleo_has_a_connector_for_each_pin_but_those_of_its_serial_link() -> None:
    board = "board_nucleo_f429zi"
    names = connectors(board)
    assert set(names) == {wire.pin for wire in wires(board)}
    link = [names.pop(wire.pin) for wire in wires(board) if wire.part == "serial link"]
    assert link == ["ST-LINK"] * 2
    assert len(set(names.values())) == len(names)


def test_a_picture_names_each_signal() -> None:
    connected = wires("board_f429")
    (axes,) = draw("a board", connected, {}).axes
    texts = [text.get_text() for text in axes.texts]
    for wire in connected:
        assert wire.signal in texts
        assert wire.pin in texts


@pytest.mark.parametrize(("name", "board"), BOARDS.items())
def test_the_pictures_of_the_pages_are_drawn_from_the_present_headers(
    name: str, board: str
) -> None:
    drawn = as_png(draw(TITLES[name], wires(board), connectors(board)), dpi=110)
    committed = (ROOT / "docs" / "images" / f"{name}.png").read_bytes()
    new, old = (imread(io.BytesIO(data), format="png") for data in (drawn, committed))
    assert new.shape == old.shape
    assert abs(new - old).max() < 0.1, "make generated"
