"""A stream of another maker, declared by a plug-in; one function in a new C file sends it."""

from __future__ import annotations

import subprocess
from typing import TYPE_CHECKING

import pytest

from protocol.messages.host import SetStreamRate, TimeRequest
from support import reference_codec as ref
from support.core_build import FIRMWARE, compile_core
from support.plugin_site import install, sweepctl_with
from support.random_scripts import Writer
from support.script_format import read, script

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

DUST, ACK = 0x50, 0x19
DECLARED = """
from typing import Annotated

from protocol.schema.fields import U16, number
from protocol.schema.message import Direction, Message, RateClass, message


@message(0x50, Direction.DEVICE, RateClass.STREAM, default_hz=4)
class Dust(Message):
    \"\"\"What the suction collects.\"\"\"

    particles: Annotated[int, number(U16, "count", "since boot; wraps")]
"""
FILLED = """
#include "streams.h"

bool stream_dust(firmware_t *firmware, sp_dust_t *message, uint32_t *sampled_us)
{
    *sampled_us -= 1500u;
    message->particles = (uint16_t)(firmware->now_us / 10000);
    return true;
}
"""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plugged")
    site, codec = folder / "site", folder / "codec"
    install(site, "dust", {"messages": {"dust": "dust_message:Dust"}}, {"dust_message": DECLARED})
    done = sweepctl_with(site, "generate", "c", "--out", codec)
    assert done.status == 0, done.err
    (folder / "dust.c").write_text(FILLED)
    sources = [FIRMWARE / "board_host" / name for name in ("script.c", "script_main.c")]
    return compile_core(folder / "script_host", codec, [*sources, folder / "dust.c"])


def frames(program: Path, writer: Writer) -> list[ref.RefFrame]:
    """Return the frames that the firmware sends while it runs a script."""
    done = subprocess.run([program], input=script(writer.acts), capture_output=True, check=True)
    wrote = b"".join(step.wrote for step in read(done.stdout))
    return [frame for frame in ref.parse_stream(wrote) if isinstance(frame, ref.RefFrame)]


def live(writer: Writer, seconds: int) -> None:
    """Keep the session open for some seconds."""
    for _ in range(seconds):
        writer.wait(900_000)
        writer.inform(TimeRequest(1), after_us=100_000)


def test_the_core_sends_it_at_its_rate_with_its_time(program: Path) -> None:
    writer = Writer()
    writer.begin()
    live(writer, 5)
    dust = [f for f in frames(program, writer) if f.type_id == DUST]
    assert len(dust) == pytest.approx(20, abs=1)
    for frame in dust:
        (particles,) = {int.from_bytes(frame.payload, "little")}
        assert frame.t_us == 10_000 * particles - 1500


def test_its_rate_can_be_set(program: Path) -> None:
    writer = Writer()
    writer.begin()
    writer.inform(SetStreamRate(9, DUST, 250))
    live(writer, 4)
    received = frames(program, writer)
    assert any(f.type_id == ACK and f.payload[:3] == b"\x09\0\x0d" for f in received)
    assert len([f for f in received if f.type_id == DUST]) == pytest.approx(100, abs=2)
