"""Handmade packet captures, and the packets that tshark reads from them.

The formats are those of the pcap and pcapng drafts (draft-ietf-opsawg-pcap, -pcapng); link types
are LINKTYPE_USER0, _USER1 and _CAN_SOCKETCAN of tcpdump.org's registry.
"""

from __future__ import annotations

import os
import struct
import subprocess
from typing import TYPE_CHECKING, NamedTuple
from xml.etree import ElementTree as ET

from bridge.record.reader import LogReader
from protocol.generate import render
from support.c_build import tool

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

USER0 = 147
"""Link type whose packets are single frames without delimiters."""
USER1 = 148
"""Link type whose packets are bytes as the host read them from the serial line."""
SOCKETCAN = 227
_EXTENDED = 0x8000_0000


class Packet(NamedTuple):
    """One packet of a capture."""

    data: bytes
    t_us: int = 0
    direction: int = 0
    """Direction: 1: to the host, 2: from the host, 0: unknown. Only pcapng stores it."""
    cut: int = 0
    """Number of bytes that the capture omits at the end of the packet."""


def write_pcap(path: Path, link_type: int, packets: Iterable[Packet]) -> None:
    """Write the pcap format: one link type, times in microseconds."""
    with path.open("wb") as file:
        file.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 0x40000, link_type))
        for packet in packets:
            kept = packet.data[: len(packet.data) - packet.cut]
            seconds, us = divmod(packet.t_us, 1_000_000)
            file.write(struct.pack("<IIII", seconds, us, len(kept), len(packet.data)) + kept)


def write_pcapng(path: Path, link_type: int, packets: Iterable[Packet]) -> None:
    """Write the pcapng format: one interface, times in microseconds, packets with directions."""
    with path.open("wb") as file:
        file.write(_block(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1)))
        file.write(_block(1, struct.pack("<HHI", link_type, 0, 0)))
        for packet in packets:
            size = len(packet.data)
            high, low = packet.t_us >> 32, packet.t_us & 0xFFFF_FFFF
            head = struct.pack("<IIIII", 0, high, low, size, size)
            flags = struct.pack("<HHIHH", 2, 4, packet.direction, 0, 0)
            file.write(_block(6, head + packet.data + bytes(-size % 4) + flags))


def _block(kind: int, body: bytes) -> bytes:
    length = struct.pack("<I", 12 + len(body))
    return struct.pack("<I", kind) + length + body + length


def socketcan(can_id: int, data: bytes, *, extended: bool = False) -> bytes:
    """Return a classic CAN frame in LINKTYPE_CAN_SOCKETCAN, the identifier in network order."""
    return struct.pack(">IBxxx", can_id | (_EXTENDED if extended else 0), len(data)) + data


def line_of_log(path: Path) -> list[Packet]:
    """Return the reads (direction 1) and writes (2) of the serial line in a run's log."""
    topics = ("/raw/uart/rx", "/raw/uart/tx")
    return [
        Packet(m.decoded.data, m.log_ns // 1000, direction=topics.index(m.topic) + 1)
        for m in LogReader(path).messages(topics)
        if m.decoded.data
    ]


# ---- reading with tshark --------------------------------------------------------------------


class Shown(NamedTuple):
    """One line of tshark's packet tree."""

    name: str
    """Name for display filters."""
    show: str
    """Value in the form that display filters use."""
    text: str
    """Text that a person reads."""


class Seen(NamedTuple):
    """One frame of this protocol as dissected by tshark."""

    packet: int
    """Number of the packet in the capture, from 1."""
    text: str
    lines: tuple[Shown, ...]

    def get(self, name: str) -> str | None:
        """Return the value of ``sweepctl.<name>``; None if the frame does not show it."""
        values = [line.show for line in self.lines if line.name == f"sweepctl.{name}"]
        assert len(values) <= 1, f"{name} is shown {len(values)} times"
        return values[0] if values else None

    def number(self, name: str) -> int:
        """Return the value of ``sweepctl.<name>`` as an integer; it may be hexadecimal."""
        value = self.get(name)
        assert value is not None, f"{name} is not shown: {self.lines}"
        return int(value, 0)

    def text_of(self, name: str) -> str:
        """Return the text that a person reads for ``sweepctl.<name>``."""
        (text,) = (line.text for line in self.lines if line.name == f"sweepctl.{name}")
        return text

    @property
    def experts(self) -> set[str]:
        """Return the names of the expert items (tshark's warnings), without their prefix."""
        return {
            line.name.removeprefix("sweepctl.") for line in self.lines if line.name in _FINDINGS
        }


_FINDINGS = {
    f"sweepctl.{name}"
    for name in (
        "bad_cobs",
        "bad_length",
        "bad_crc",
        "bad_order",
        "cut",
        "other_version",
        "unknown_type",
        "payload_length",
        "no_tag",
        "out_of_range",
    )
}
_OURS = {"sweepctl", "sweepctl_can"}
_HARMLESS = 'Running as user "root"'


class Tshark:
    """tshark with the generated dissector and without user settings, in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        (script,) = render("lua").values()
        path = folder / "script.lua"
        path.write_text(script, encoding="utf-8")
        self._folder = folder
        self._command = [tool("tshark"), "-n", "-X", f"lua_script:{path}"]
        self._environment = {**os.environ, "WIRESHARK_CONFIG_DIR": str(folder / "settings")}

    def run(self, capture: Path, *arguments: str) -> str:
        """Return standard output; output on stderr is a failure."""
        done = subprocess.run(
            [*self._command, "-r", str(capture), *arguments],
            env=self._environment,
            capture_output=True,
            text=True,
            timeout=100,
            check=False,
        )
        complaints = [x for x in done.stderr.splitlines() if x and not x.startswith(_HARMLESS)]
        assert not complaints, complaints
        assert done.returncode == 0
        assert "Lua Error" not in done.stdout
        return done.stdout

    def dissect(self, capture: Path, *arguments: str) -> list[Seen]:
        """Return every frame of ours in order; several frames in one packet are separate."""
        root = ET.fromstring(self.run(capture, "-T", "pdml", *arguments))  # noqa: S314 - tshark's own
        return [
            Seen(number, node.get("showname") or node.get("show") or "", tuple(_lines(node)))
            for number, packet in enumerate(root.iter("packet"), 1)
            for node in packet.iter()
            if node.get("name") in _OURS
        ]

    def dissect_packets(self, link_type: int, packets: Iterable[Packet]) -> list[Seen]:
        """Return every frame of ours in a capture of these packets."""
        capture = self._folder / "made.pcap"
        write_pcap(capture, link_type, packets)
        return self.dissect(capture)


def _lines(node: ET.Element) -> Iterator[Shown]:
    for child in node:
        name = child.get("name") or ""
        if name not in _OURS:
            yield Shown(name, child.get("show") or "", child.get("showname") or "")
            yield from _lines(child)
