"""Transfer of a log to Rerun, during its recording or later at its recorded speed.

During a live run, this module is a separate process (``python -m bridge.view.rerun.feeder``) that
only reads the log's file. So a slow, frozen or closed viewer delays only this process. The file is
the buffer, so delayed data are shown later.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import sys
import threading
import uuid
from collections.abc import Callable  # noqa: TC003 - the type of a dataclass field
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.io import clock
from bridge.io.free_port import free_tcp_port
from bridge.record.names import readable_name
from bridge.record.reader import LogReader
from bridge.view.errors import ViewerFailedError
from bridge.view.following import POLL_S, Follower, paced, wait_for_log
from bridge.view.rerun.launch import APPLICATION, viewer_environment, viewer_program
from bridge.view.run_reading import plan_of, robot_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    import rerun as rr

    from bridge.record.reader import LogMessage
    from bridge.view.rerun.columns import RerunRecording

_LOOPBACK = "127.0.0.1"
_FLUSH_S = 1.0
"""Time limit of one flush to the viewer, s."""
_BEGIN_S = 10.0
"""Time limit for the log to appear, s."""
_MEMORY = "1GB"
"""Memory limit of the viewer. Above it, the oldest data is dropped."""
_NICE = 10
"""Nice value of this process and the viewer, because driving has priority over drawing."""
_BATCH = 5_000
"""Maximum number of messages in one conversion. Many messages may wait after the viewer was
frozen."""


@dataclass(frozen=True, slots=True)
class FeedOptions:
    """Options of a feed."""

    log: Path
    follow: bool = False
    """True if the log is still being written."""
    speed: float | None = None
    """Seconds of the log for each second of real time; None: as fast as possible."""
    start_s: float = 0.0
    end_s: float | None = None
    serve: bool = False
    """True to serve a browser on this machine instead of opening a window."""
    headless: bool = False
    """True to render off screen, for tests."""
    address_file: Path | None = None
    """File for the viewer's address, written after the start."""
    report: Callable[[str], None] = lambda _text: None
    """Function that is called with the address for a browser."""


class Viewer:
    """The viewer's process, which listens on the loopback interface only."""

    def __init__(self, *, serve: bool, headless: bool = False) -> None:
        """Start the viewer.

        Raises:
            ViewerMissingError: Rerun is not installed, or without its viewer.

        """
        self.serve = serve
        self.port = free_tcp_port()
        command = [str(viewer_program()), "--bind", _LOOPBACK, "--port", str(self.port)]
        self.page = ""
        """Address for a browser; empty unless the viewer is served."""
        if serve:
            web_port = free_tcp_port()
            command += ["--serve-web", "--web-viewer-port", str(web_port)]
            command += ["--server-memory-limit", _MEMORY]
            self.page = f"http://{_LOOPBACK}:{web_port}/?url={self.address.replace('+', '%2B')}"
        else:
            command += ["--hide-welcome-screen", "--expect-data-soon", "--memory-limit", _MEMORY]
            command += ["--headless"] if headless else []
        self.process = subprocess.Popen(  # noqa: S603 - the installed viewer
            command,
            env=viewer_environment("error"),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C ends the run, not the viewer
        )

    @property
    def address(self) -> str:
        """Address at which the viewer receives data."""
        return f"rerun+http://{_LOOPBACK}:{self.port}/proxy"

    @property
    def ended(self) -> bool:
        """True if the window was closed or the viewer crashed."""
        return self.process.poll() is not None

    def close(self) -> None:
        """Terminate the viewer."""
        self.process.terminate()


def feed(options: FeedOptions, ended: Callable[[], bool] = lambda: False) -> None:
    """Show a log until its end, until the viewer is closed, or until ``ended`` returns True.

    A window stays open afterwards. A server serves until ``ended`` returns True, also after the end
    of the log. It is closed before this function returns.

    Raises:
        LogReadError: the log is missing, cannot be read, or is no MCAP file.
        ViewerMissingError: Rerun is not installed.
        ViewerFailedError: the viewer ended before it received data.

    """
    if options.follow:
        wait_for_log(options.log, _BEGIN_S)
    reader = LogReader(options.log)
    viewer = Viewer(serve=options.serve, headless=options.headless)
    if options.address_file is not None:
        _write_address(options.address_file, viewer)
    if viewer.page:
        options.report(f"open {viewer.page}")
    try:
        _Feed(viewer, reader, options).run(ended)
        while options.serve and not viewer.ended and not ended():
            clock.pause(POLL_S)
    finally:
        if options.serve:
            viewer.close()


class _Feed:
    """Feeds one log to one viewer."""

    def __init__(self, viewer: Viewer, reader: LogReader, options: FeedOptions) -> None:
        import rerun as rr  # noqa: PLC0415 - slow to load

        from bridge.view.rerun.convert import RunConverter  # noqa: PLC0415 - rerun

        self._viewer, self._reader, self._options = viewer, reader, options
        self._plan, self._model = plan_of(reader), robot_of(reader)
        self._run = RunConverter(self._model)
        self._stream: rr.RecordingStream = rr.RecordingStream(
            APPLICATION, recording_id=uuid.uuid4()
        )
        self._recording: RerunRecording | None = None
        self._is_live = options.follow or options.speed is not None

    def run(self, ended: Callable[[], bool]) -> None:
        """Send the log in batches."""
        self._stream.connect_grpc(self._viewer.address)
        for batch in self._batches(ended):
            for begin in range(0, len(batch), _BATCH):
                self._send(batch[begin : begin + _BATCH])
                if not self._delivered(ended):
                    return
        if self._recording is None and self._viewer.ended:
            raise ViewerFailedError(self._viewer.process.returncode, "it ended unexpectedly")

    def _batches(self, ended: Callable[[], bool]) -> Iterator[list[LogMessage]]:
        options, topics = self._options, self._run.topics
        if not options.follow:
            messages = self._reader.messages(topics)
            speed = options.speed if options.speed is not None else float("inf")
            if speed == float("inf"):
                yield list(messages)
                return
            yield from paced(messages, speed, start_s=options.start_s, end_s=options.end_s)
            return
        follower = Follower(options.log, topics)
        while True:
            last = ended()
            yield follower.more()
            if last or (follower.ended and not follower.next_file()):
                return
            clock.pause(POLL_S)

    def _send(self, batch: list[LogMessage]) -> None:
        from bridge.view.rerun import scene  # noqa: PLC0415 - loads rerun
        from bridge.view.rerun.blueprint import blueprint  # noqa: PLC0415 - loads rerun
        from bridge.view.rerun.columns import RerunRecording  # noqa: PLC0415 - loads rerun

        if self._recording is None:
            if not batch:
                return
            self._recording = RerunRecording(self._stream, batch[0].log_ns)
            scene.draw_robot(self._recording, self._model)
            if self._plan is not None:
                scene.draw_plan(self._recording, self._plan)
            whole_s = None if self._is_live else (batch[-1].log_ns - batch[0].log_ns) / 1e9
            self._stream.send_blueprint(blueprint(self._plan, whole_s))
            self._stream.send_recording_name(readable_name(self._options.log.stem))
        for message in batch:
            self._run.take(message)
        self._run.send(self._recording)

    def _delivered(self, ended: Callable[[], bool]) -> bool:
        """Wait until the viewer has received everything; False if it cannot."""
        while not self._viewer.ended:
            with contextlib.suppress(RuntimeError, ValueError, TimeoutError):
                self._stream.flush(timeout_sec=_FLUSH_S)
                return True
            if ended() and not self._options.follow:
                return False
        return False


def _write_address(path: Path, viewer: Viewer) -> None:
    """Write the addresses to a temporary file and rename it, so that no reader reads a part."""
    part = path.with_suffix(".part")
    part.write_text(f"{viewer.address}\n{viewer.page}\n{viewer.process.pid}\n", encoding="ascii")
    part.replace(path)


def main(arguments: list[str] | None = None) -> int:
    """Follow a log until its end, or until the parent process closes the standard input."""
    parser = argparse.ArgumentParser(prog="python -m bridge.view.rerun.feeder")
    parser.add_argument("log", type=Path)
    parser.add_argument("--serve", action="store_true")
    parser.add_argument("--headless", action="store_true")
    parser.add_argument("--address-file", type=Path)
    asked = parser.parse_args(arguments)
    with contextlib.suppress(AttributeError, OSError):
        os.nice(_NICE)  # the viewer inherits it
    left = threading.Event()

    def watch() -> None:
        with contextlib.suppress(OSError):
            while os.read(sys.stdin.fileno(), 64):
                pass
        left.set()

    threading.Thread(target=watch, daemon=True).start()
    options = FeedOptions(
        asked.log,
        follow=True,
        serve=asked.serve,
        headless=asked.headless,
        address_file=asked.address_file,
    )
    feed(options, left.is_set)
    # Rerun's exit handler would wait for the viewer, which may be frozen.
    os._exit(0)


if __name__ == "__main__":
    sys.exit(main())
