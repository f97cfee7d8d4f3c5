"""``sweepctl replay``: play a log in the viewer, or as a robot on a port."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from tools.cli import options
from tools.cli.console import flush, inform, write_line
from tools.cli.foxglove import foxglove_option
from tools.cli.log_file import LogPath
from tools.cli.paths import PathName

if TYPE_CHECKING:
    from pathlib import Path


@click.command(
    "replay",
    epilog="Example:  sweepctl replay clean.mcap --link pty --pty-link /tmp/recorded",
)
@click.argument("file", type=LogPath())
@click.option(
    "--speed",
    type=options.Number(0.01, 1000.0),
    metavar="FACTOR",
    help="Playback speed in the viewer or in Foxglove.  [default: 1]",
)
@click.option(
    "--from",
    "start_s",
    type=options.Number(0.0, 1e9),
    default=0.0,
    metavar="S",
    help="Start of the playback, seconds after the beginning of the log.",
)
@click.option(
    "--to",
    "end_s",
    type=options.Number(0.0, 1e9),
    metavar="S",
    help="End of the playback, seconds after the beginning of the log.",
)
@click.option("--serve", is_flag=True, help="Show the log in a browser on this machine.")
@foxglove_option
@click.option(
    "--link",
    type=click.Choice(["pty"]),
    help="Play the recorded robot on a virtual serial port, in real time, for `connect`.",
)
@click.option(
    "--pty-link",
    type=PathName(dir_okay=False),
    help="Symbolic link to the port to create.",
)
@click.option(
    "--check",
    is_flag=True,
    help="Play nothing; decode the raw bytes again and compare them bit for bit with the messages.",
)
@options.json_option
def command(  # noqa: PLR0913 - one parameter per option
    *,
    file: Path,
    speed: float | None,
    start_s: float,
    end_s: float | None,
    serve: bool,
    foxglove: tuple[str, int] | None,
    link: str | None,
    pty_link: Path | None,
    check: bool,
    as_json: bool,
) -> int:
    """Play FILE in Rerun or Foxglove, or as a robot on a virtual port.

    FILE is a log, a `candump -l` log, or the raw bytes of a serial line. With --link the recorded
    robot is on a port, whose name is the first line on stdout ("ready PORT"). It sends its recorded
    bytes, including damaged ones, answers hello and time sync, and cannot be driven.
    """
    from bridge.convert.file_kinds import MCAP, kind_of
    from bridge.convert.sources import readable

    is_part = bool(start_s) or end_s is not None
    is_viewed = serve or foxglove is not None or speed is not None or is_part
    _check_usage(link, pty_link, check=check, as_json=as_json, is_viewed=is_viewed)
    if serve and foxglove is not None:
        raise click.UsageError("give --serve (Rerun) or --foxglove, not both")
    if end_s is not None and end_s <= start_s:
        raise click.UsageError(f"--to {end_s:g} is not after --from {start_s:g}")
    if check and kind_of(file) != MCAP:
        from bridge.record.errors import LogReadError

        raise LogReadError(file, "it is a capture without messages to compare the bytes with")
    with readable(file) as log:
        if check:
            return _check(log, as_json=as_json)
        if link is not None:
            return _serve(log, pty_link)
        _check_start(log, start_s)
        if foxglove is not None:
            return _foxglove(log, foxglove, speed or 1.0, (start_s, end_s))
        return _view(log, speed or 1.0, (start_s, end_s), serve=serve)


def _check_usage(
    link: str | None, pty_link: Path | None, *, check: bool, as_json: bool, is_viewed: bool
) -> None:
    """Check that the options can be combined.

    Raises:
        click.UsageError: the options cannot be combined.

    """
    if pty_link is not None and link is None:
        raise click.UsageError("--pty-link needs --link pty")
    if check and (link is not None or is_viewed):
        raise click.UsageError("--check plays nothing: give no option with it but --json")
    if link is not None and is_viewed:
        raise click.UsageError(
            "--link plays the whole log in real time: omit --speed, --serve, --foxglove, --from "
            "and --to"
        )
    if as_json and not check:
        raise click.UsageError("--json needs --check")


def _check_start(log: Path, start_s: float) -> None:
    """Check that the log has a message after the start.

    Raises:
        click.UsageError: it has none.

    """
    from bridge.record.info import describe

    if start_s and start_s > (length_s := describe(log).duration_s):
        raise click.UsageError(f"--from {start_s:g} is after the end: the log has {length_s:.1f} s")


def _check(log: Path, *, as_json: bool) -> int:
    from bridge.convert.redecode import as_json as comparison_json
    from bridge.convert.redecode import compare
    from bridge.record.errors import LogReadError

    result = compare(log)
    if not result.recorded:
        raise LogReadError(log, "it contains no messages of a robot to compare the bytes with")
    if as_json:
        write_line(comparison_json(result))
    elif result.same:
        inform(f"all {result.equal} messages of the device equal the decoded bytes, bit for bit")
    else:
        inform(f"{result.equal} of {result.recorded} messages are equal; {result.first}")
    return 0 if result.same else 1


def _serve(log: Path, pty_link: Path | None) -> int:
    from bridge.errors import PortError
    from bridge.record.reader import LogReader
    from bridge.replay.device import replay_device
    from sim_device.ports.base import PortUnavailableError, Stopper
    from sim_device.ports.pty_port import PtyPort
    from tools.cli.signals import until_signalled
    from tools.virtual.replaying import serve

    device = replay_device(LogReader(log))
    stopper = Stopper()
    try:
        with until_signalled(stopper.stop), PtyPort(pty_link) as port:
            write_line(f"ready {port.path}")
            flush()
            name = device.recording.hello.name
            inform(f"{name}, {device.recording.duration_s:.1f} s recorded; press Ctrl-C to end")
            serve(device, port, stopper)
    except PortUnavailableError as error:
        raise PortError(str(error)) from None
    finally:
        stopper.close()
    return 0


def _foxglove(
    log: Path, address: tuple[str, int], speed: float, span_s: tuple[float, float | None]
) -> int:
    """Play a log to Foxglove, then serve its last state until a signal arrives."""
    import threading

    from bridge.record.names import ROBOT_ATTACHMENT
    from bridge.record.reader import LogReader
    from bridge.view.following import paced
    from bridge.view.foxglove.replaying import LogFeed
    from tools.cli.foxglove import live_foxglove, run_parameters
    from tools.cli.signals import until_signalled

    reader, ended = LogReader(log), threading.Event()
    robot = reader.attachments.get(ROBOT_ATTACHMENT, b"").decode("utf-8", "replace")
    with until_signalled(ended.set), live_foxglove(address, run_parameters(robot)) as publisher:
        if publisher is None:
            return 0
        feed = LogFeed(publisher)
        start_s, end_s = span_s
        for batch in paced(reader.messages(), speed, start_s=start_s, end_s=end_s):
            if ended.is_set():
                return 0
            feed.take(batch)
        inform("the end of the log is reached; press Ctrl-C to end")
        ended.wait()
    return 0


def _view(log: Path, speed: float, span_s: tuple[float, float | None], *, serve: bool) -> int:
    import threading

    from bridge.view.rerun.feeder import FeedOptions, feed
    from tools.cli.recording import check_view
    from tools.cli.signals import until_signalled

    check_view(view=True, serve=serve)
    ended = threading.Event()
    start_s, end_s = span_s
    options_ = FeedOptions(
        log, speed=speed, start_s=start_s, end_s=end_s, serve=serve, report=inform
    )
    with until_signalled(ended.set):
        feed(options_, ended.is_set)
    return 0
