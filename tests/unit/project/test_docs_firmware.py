"""The pages about firmware name only existing C names and files, and explain every error."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Annotated
from zlib import crc32

import pytest
from cobs import cobs

from bridge.run.robot_state import missing_needs
from bridge.session.session import Session
from bridge.session.states import Failed
from protocol.clock import HostNs
from protocol.generate import render
from protocol.messages.host import Stop
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION
from protocol.schema.comparison import Match, MessageComparison
from protocol.schema.fields import U8, number
from support.ends import Ends, session_end, sweeper
from support.peers import catalogue, variant
from support.root import ROOT

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.schema.message import MessageSpec

SECOND_NS = 1_000_000_000
PAGE = ROOT / "docs" / "firmware.md"
TEXT = PAGE.read_text(encoding="utf-8") + (ROOT / "docs" / "device-rules.md").read_text(
    encoding="utf-8"
)
HEADER = render("c")["sweepctl_protocol.h"]


def test_every_name_of_the_generated_c_exists() -> None:
    sources = HEADER + render("c")["sweepctl_protocol.c"]
    names = set(re.findall(r"\b(?:sp|SP)_\w+", TEXT))
    assert len(names) > 15
    assert {n for n in names if not re.search(rf"\b{n}\b", sources)} == set()


def test_every_link_leads_to_a_file() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", TEXT)
    assert len(links) >= 4
    assert [link for link in links if not (PAGE.parent / link).exists()] == []


def test_it_names_all_that_driving_needs() -> None:
    def lacks(spec: MessageSpec) -> bool:
        return bool(missing_needs([MessageComparison(spec, Match.MISSING, 0)]))

    needed = {spec.name for spec in CATALOGUE if lacks(spec)}
    paragraph = TEXT[TEXT.index("`connect --plan` the device needs") :].split("\n\n")[0]
    assert needed == set(re.findall(r"`([a-z_]+)`", paragraph))


def test_the_minimal_set_and_range_suffice_for_driving() -> None:
    for name in ("imu", "encoders", "status", "velocity_setpoint", "clear_stop", "set_mode"):
        assert f"#define SP_WITH_{name.upper()} SP_WITH_REST" not in HEADER
    assert "#define SP_WITH_RANGE SP_WITH_REST" in HEADER


def on_a_line(feed: bytes = b"", *, echo: bool = False) -> Failed:
    """Return how a session fails on a serial link without a sweeper."""
    session = Session(lambda: 1)
    now = HostNs(5 * SECOND_NS)
    session.open(now)
    failed: list[Failed] = []
    while not failed:
        events = session.receive(feed, now) if feed else []
        events += session.poll(now)
        if echo:
            events += session.receive(session.data_to_send(), now)
        failed = [event for event in events if isinstance(event, Failed)]
        now = HostNs(now + SECOND_NS // 100)
        assert now < 60 * SECOND_NS
    return failed[0]


def with_a_device(*, transmit_only: bool = False, less_of_stop: bool = False) -> Failed:
    """Return how a session fails with a device that cannot receive, or whose stop lacks a field."""
    host = session_end()
    shorter = variant(Stop, {"command_id": Annotated[int, number(U8, "id", "shorter")]})
    device = sweeper(catalogue=catalogue(more=[shorter])) if less_of_stop else sweeper()
    ends = Ends(host, device)
    ends.to_device.cut = transmit_only
    assert ends.run(20.0, lambda: bool(host.of(Failed)))
    (failed,) = host.of(Failed)
    return failed


def of_a_later_version() -> bytes:
    """Return a frame of the next protocol version, with a valid CRC."""
    body = bytes([PROTOCOL_VERSION + 1 << 4, 1, 0x1B, 0, 0, 0, 0, 0]) + bytes(40)
    encoded: bytes = cobs.encode(body + crc32(body).to_bytes(4, "little"))
    return b"\0" + encoded + b"\0"


FAILURES: dict[str, Callable[[], Failed]] = {
    "silence": on_a_line,
    "garbage": lambda: on_a_line(bytes(range(200))),
    "echo": lambda: on_a_line(echo=True),
    "version": lambda: on_a_line(of_a_later_version()),
    "transmit_only": lambda: with_a_device(transmit_only=True),
    "incompatible": lambda: with_a_device(less_of_stop=True),
}


@pytest.mark.parametrize("kind", FAILURES)
def test_every_error_of_the_host_is_explained(kind: str) -> None:
    """The page has a row with the text of each failure that the test causes."""
    failed = FAILURES[kind]()
    assert failed.kind == kind
    first_cells = re.findall(r"^\| ([^|]+) \| [^|]{10,} \|$", TEXT, re.MULTILINE)
    rows = [cell.strip(" …") for cell in first_cells if cell.strip(" …") in failed.text]
    assert len(rows) == 1, (failed.text, first_cells)
