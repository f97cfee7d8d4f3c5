"""Runs ``sweepctl`` as users type it, and reads its logs as another program would."""

from __future__ import annotations

import io
import subprocess
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from bridge.motion.robot_model import RobotModel
from bridge.record.sink import NullSink
from support.json_schema import check_output
from support.processes import COMMAND, Done, environment
from tools.cli.main import run
from tools.cli.rooms import load_room
from tools.virtual.run import run_virtual
from tools.virtual.summary import summarise

if TYPE_CHECKING:
    import signal
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    import pytest
    from mcap.records import Channel, Message

PATIENCE_S = 110.0
"""Maximum time of a command that usually takes seconds, s; only a hang is longer."""


def sweepctl(*arguments: str | Path) -> Done:
    """Run the command in this process; check the output of ``--json`` against its schema."""
    out, err = io.StringIO(), io.StringIO()
    words = [str(argument) for argument in arguments]
    with redirect_stdout(out), redirect_stderr(err):
        status = run(words)
    done = Done(status, out.getvalue(), err.getvalue())
    if "--json" in words and done.out:
        check_output(words, done.out)
    return done


def start(
    *arguments: str | Path,
    cwd: Path,
    env: Mapping[str, str] | None = None,
    own_group: bool = False,
) -> subprocess.Popen[str]:
    """Start the command in a separate process.

    With ``own_group``, it has its own process group, like a command that a shell starts.
    """
    return subprocess.Popen(
        [*COMMAND, *map(str, arguments)],
        cwd=cwd,
        env=environment(**(env or {})),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=own_group,
    )


def end(process: subprocess.Popen[str], number: signal.Signals | None = None) -> Done:
    """Wait for a process, after a signal if one is given."""
    if number is not None:
        process.send_signal(number)
    try:
        out, err = process.communicate(timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        raise
    return Done(process.returncode, out, err)


class Recorded(NamedTuple):
    """A simulated run, recorded."""

    log: Path
    done: Done


def case_1(factory: pytest.TempPathFactory) -> Recorded:
    """Return a whole run of the paper's case 1; it is made once for all tests."""
    return _case_1(factory.getbasetemp())


@cache
def _case_1(base: Path) -> Recorded:
    folder = base / "case-1"
    folder.mkdir(exist_ok=True)
    log = folder / "run.mcap"
    process = start(
        *("simulate", "case-1", "--planner", "paper", "--seed", "1", "--json", "--out", log),
        cwd=folder,
    )
    return Recorded(log, end(process))


def short_runs(factory: pytest.TempPathFactory) -> tuple[Recorded, Recorded, Recorded]:
    """Return three drives of twelve seconds with the seeds 4, 4 and 5, made once for all tests.

    Each drive runs in a separate process with a different hash seed of Python.
    """
    return _short_runs(factory.getbasetemp())


@cache
def _short_runs(base: Path) -> tuple[Recorded, Recorded, Recorded]:
    folder = base / "short"
    folder.mkdir(exist_ok=True)
    logs = [folder / f"{name}.mcap" for name in ("first", "again", "other")]
    processes = [
        start(
            *(
                "simulate",
                "case-1",
                "--planner",
                "paper",
                "--seed",
                seed,
                "--max-time",
                "12",
                "--json",
                "--out",
                log,
            ),
            cwd=folder,
            env={"PYTHONHASHSEED": str(index)},
        )
        for index, (seed, log) in enumerate(zip(("4", "4", "5"), logs, strict=True))
    ]
    first, again, other = (
        Recorded(log, end(process)) for log, process in zip(logs, processes, strict=True)
    )
    return first, again, other


def summary(room: str, planner: str, seed: int) -> dict[str, Any]:
    """Return the result of a run without a log."""
    plan, model = load_room(room), RobotModel()
    finished = run_virtual(plan, model, planner, NullSink(), seed=seed)
    return summarise(finished, plan, planner, seed, None)


class Plain(NamedTuple):
    """A message as the MCAP library returns it."""

    topic: str
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes

    @classmethod
    def of(cls, channel: Channel, message: Message) -> Plain:
        """Create the object from the library's own records."""
        times = (message.log_time, message.publish_time)
        return cls(channel.topic, *times, message.sequence, message.data)


def plain_messages(log: Path, *topics: str) -> list[Plain]:
    """Return every message of these topics (none: of all), in the order of the file."""
    with log.open("rb") as file:
        found = make_reader(file).iter_messages(topics or None, log_time_order=False)
        return [Plain.of(channel, message) for _, channel, message in found]


def decoded(log: Path, *topics: str) -> Iterator[tuple[Plain, Any]]:
    """Yield messages of protobuf topics, decoded by the library with the file's own schema."""
    with log.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found = reader.iter_decoded_messages(topics, log_time_order=False)
        for _, channel, message, value in found:
            yield Plain.of(channel, message), value


def attachments(log: Path) -> dict[str, bytes]:
    """Return the attachments of a log, by name."""
    with log.open("rb") as file:
        return {item.name: item.data for item in make_reader(file).iter_attachments()}
