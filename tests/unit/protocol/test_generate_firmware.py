"""The generated files in the firmware's folder, committed for builds without Python, are fresh."""

from __future__ import annotations

from protocol.generate import render
from support.root import ROOT
from tools.dev import firmware_tables

FOLDER = ROOT / "sim_device" / "firmware" / "protocol"


def test_the_committed_codec_is_fresh() -> None:
    stale = [
        name
        for name, text in render("c").items()
        if (FOLDER / name).read_text(encoding="utf-8") != text
    ]
    command = "sweepctl generate c --force --out sim_device/firmware/protocol"
    assert not stale, f"{', '.join(stale)} stale; run: {command}"


def test_the_committed_tables_of_parameters_and_modes_are_fresh() -> None:
    stale = [
        name
        for name, text in firmware_tables.render().items()
        if (firmware_tables.FOLDER / name).read_text(encoding="utf-8") != text
    ]
    assert not stale, f"{', '.join(stale)} stale; run: {firmware_tables.COMMAND}"
