"""The page for firmware engineers names only what there is."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from bridge import session_handshake as handshake
from bridge.robot_state import missing_needs
from bridge.session import Session
from bridge.session_evidence import Evidence
from protocol.agreement import Match, MessageAgreement
from protocol.catalogue import CATALOGUE
from protocol.generate import render

if TYPE_CHECKING:
    from protocol.message import MessageSpec

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "firmware.md"
TEXT = PAGE.read_text(encoding="utf-8")
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
        return bool(missing_needs([MessageAgreement(spec, Match.MISSING, 0)]))

    needed = {spec.name for spec in CATALOGUE if lacks(spec)}
    paragraph = TEXT[TEXT.index("`connect --plan` the device needs") :].split("\n\n")[0]
    assert needed == set(re.findall(r"`([a-z_]+)`", paragraph))


def test_the_minimal_set_and_range_are_what_driving_needs() -> None:
    for name in ("imu", "encoders", "status", "velocity_setpoint", "clear_stop", "set_mode"):
        assert f"#define SP_WITH_{name.upper()} SP_WITH_REST" not in HEADER
    assert "#define SP_WITH_RANGE SP_WITH_REST" in HEADER


def test_what_the_host_complains_of_is_explained() -> None:
    """By the words that the session uses."""
    files = [handshake.__file__, Session.__init__.__code__.co_filename]
    files.append(Evidence.verdict.__code__.co_filename)
    source = "".join(Path(str(file)).read_text(encoding="utf-8") for file in files)
    for words in (
        "nothing was heard",
        "our own bytes come back",
        "the device speaks protocol version",
        "the device is heard but does not answer",
        "none of them an intact frame",
        "no common ground",
    ):
        assert words in source, words
        assert words in TEXT, words
