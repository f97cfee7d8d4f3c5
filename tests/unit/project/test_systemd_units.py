"""The systemd units in ``examples/systemd``, and the notification script that they start."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from typing import TYPE_CHECKING

import click
import pytest

from support.root import ROOT
from tools.cli.main import cli
from tools.commands.connect import command as connect

if TYPE_CHECKING:
    from pathlib import Path

FOLDER = ROOT / "examples" / "systemd"
PROGRAM = "/usr/local/bin/sweepctl"


def complaints(folder: Path, service: str) -> str:
    """Return the errors and warnings of ``systemd-analyze verify`` about the units."""
    program = folder / "sweepctl"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    (folder / "sweepctl@.service").write_text(service.replace(PROGRAM, str(program)))
    timer = (FOLDER / "sweepctl@.timer").read_text("utf-8")
    (folder / "sweepctl@.timer").write_text(timer)
    units = [str(folder / f"sweepctl@kitchen.{kind}") for kind in ("service", "timer")]
    program_path = shutil.which("systemd-analyze")
    assert program_path is not None
    done = subprocess.run(
        [program_path, "verify", "--man=no", *units],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**os.environ, "SYSTEMD_COLORS": "0"},
    )
    # systemd also reports problems of other units of the machine.
    mine = [line for line in done.stderr.splitlines() if str(folder) in line or "kitchen" in line]
    return "\n".join(mine) or ("" if done.returncode == 0 else done.stderr)


@pytest.mark.needs("systemd-analyze")
def test_systemd_accepts_the_units(tmp_path: Path) -> None:
    assert complaints(tmp_path, (FOLDER / "sweepctl@.service").read_text("utf-8")) == ""


@pytest.mark.needs("systemd-analyze")
@pytest.mark.parametrize(
    ("right", "wrong"),
    [("KillMode=mixed", "KillMode=mixd"), ("ProtectHome=", "ProtectHomes="), (PROGRAM, "/none")],
)
def test_the_check_finds_a_wrong_line(tmp_path: Path, right: str, wrong: str) -> None:
    service = (FOLDER / "sweepctl@.service").read_text("utf-8")
    assert right in service
    assert complaints(tmp_path, service.replace(right, wrong)) != ""


def test_the_unit_starts_a_command_line_that_connect_takes() -> None:
    service = (FOLDER / "sweepctl@.service").read_text("utf-8").replace("\\\n", "")
    found = re.search(rf"^ExecStart={PROGRAM} connect %i (.*)$", service, re.MULTILINE)
    assert found is not None
    words = ["/dev/ttyUSB0", *found[1].split()]
    # The context needs the settings of the group, because click keeps the help options of the
    # first context.
    parent = cli.make_context("sweepctl", ["connect"], resilient_parsing=True)
    context = connect.make_context("connect", words, parent=parent)
    assert isinstance(context, click.Context)
    assert context.params["supervise"]
    assert len(context.params["on_events"]) == 4


def test_the_script_forwards_the_event_and_the_text(tmp_path: Path) -> None:
    for name in ("mosquitto_pub", "curl"):
        fake = tmp_path / name
        fake.write_text(f'#!/bin/sh\necho "$@" > {tmp_path}/{name}.words\n')
        fake.chmod(0o755)
    (tmp_path / "mosquitto_pub").write_text(
        f'#!/bin/sh\necho "$@" > {tmp_path}/mosquitto_pub.words\ncat > {tmp_path}/sent\n'
    )
    subprocess.run(
        ["/bin/sh", str(FOLDER / "notify.sh")],
        input='{"event": "finished"}\n',
        text=True,
        check=True,
        timeout=60,
        env={
            "PATH": f"{tmp_path}:{os.environ['PATH']}",
            "SWEEPCTL_EVENT": "finished",
            "SWEEPCTL_TEXT": "all floors are clean",
            "NTFY_TOPIC": "robots",
        },
    )
    assert (tmp_path / "sent").read_text() == '{"event": "finished"}\n'
    published = (tmp_path / "mosquitto_pub.words").read_text()
    assert "-t sweepctl/finished" in published
    posted = (tmp_path / "curl.words").read_text()
    assert "-d all floors are clean https://ntfy.sh/robots" in posted
