"""Queued output: the writer never waits, even if the reader stops, closes or resumes."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import threading
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest

from support.root import ROOT
from tools.cli.output_queue import QUEUE_BYTES, QueuedOutput, QueuedStream

if TYPE_CHECKING:
    from collections.abc import Iterator

PATIENCE_S = 60.0
LIMIT = QUEUE_BYTES[False]


class Pipe:
    """A pipe whose reader reads on request."""

    def __init__(self) -> None:
        self._read_end, write_end = os.pipe()
        # Left open: a thread may be writing to it when a test ends.
        self.stream = open(write_end, "w", encoding="utf-8", closefd=False)  # noqa: SIM115 - as above
        self._is_read = True

    def fill(self) -> None:
        """Write until the pipe is full."""
        number = self.stream.fileno()
        os.set_blocking(number, False)
        with suppress(BlockingIOError):
            while True:
                os.write(number, b".")
        os.set_blocking(number, True)

    def read(self, last: bytes) -> bytes:
        """Read until these bytes have arrived."""
        data = b""
        while last not in data:
            data += os.read(self._read_end, 1 << 20)
        return data

    def leave(self) -> None:
        """Close the reader's end."""
        if self._is_read:
            self._is_read = False
            os.close(self._read_end)


@pytest.fixture
def pipe() -> Iterator[Pipe]:
    made = Pipe()
    yield made
    made.leave()


def test_written_bytes_arrive_in_order(pipe: Pipe) -> None:
    queued = QueuedStream(pipe.stream)
    text = "".join(f"line {number} of m²\n" for number in range(1000))
    for line in text.splitlines(keepends=True):
        assert queued.write(line) == len(line)
    queued.drain()
    assert pipe.read(b"line 999 of m\xc2\xb2\n").decode() == text


def test_a_reader_that_stands_still_costs_the_writer_nothing_but_lines(pipe: Pipe) -> None:
    pipe.fill()
    queued = QueuedStream(pipe.stream)
    line = "x" * 999 + "\n"
    written = 0
    while written < 2 * LIMIT:  # the test would hang if a write waited
        written += queued.write(line)
    queued.drain()  # drain() gives up after a limited time
    before = pipe.read(b"x\n").lstrip(b".")
    text = before + pipe.read(b"the reader is too slow\n")
    lines = text.decode().splitlines()
    assert lines[-1].startswith("sweepctl: ")
    dropped = int(lines[-1].split()[1])
    assert len(lines) - 1 + dropped == written // 1000
    assert LIMIT // 1000 - 1 <= len(lines) - 1 <= LIMIT // 1000 + 1
    queued.write("more\n")
    assert pipe.read(b"more\n") == b"more\n", "output continues, and the loss is reported once"


def test_lines_dropped_on_stdout_are_counted_on_stderr(pipe: Pipe) -> None:
    pipe.fill()
    people = Pipe()
    queued = QueuedStream(pipe.stream, notices=QueuedStream(people.stream))
    for _ in range(LIMIT // 100_000 + 5):
        queued.write("x" * 99_999 + "\n")
    reader = threading.Thread(target=pipe.read, args=(b"the end",), daemon=True)
    reader.start()
    assert people.read(b"\n").endswith(b"lines were dropped: the reader is too slow\n")
    queued.write("the end")
    reader.join(PATIENCE_S)
    people.leave()


def test_waiting_messages_can_be_dropped_for_newer_ones(pipe: Pipe) -> None:
    pipe.fill()
    queued = QueuedStream(pipe.stream)
    for number in range(100):
        queued.write(f"picture {number}\n")
    queued.drop_queued()
    queued.write("the end\n")
    text = pipe.read(b"the end\n").lstrip(b".").decode()
    assert text in {"the end\n", "picture 0\nthe end\n"}


def test_a_whole_text_is_kept_however_long_it_is(pipe: Pipe) -> None:
    queued = QueuedStream(pipe.stream)
    text = "y" * (LIMIT + 1) + "\n"
    queued.write(text)
    assert pipe.read(b"y\n").decode() == text


@pytest.mark.parametrize("raises", [True, False])
def test_a_reader_that_left(raises: bool, pipe: Pipe) -> None:  # noqa: FBT001 - pytest's
    pipe.leave()
    queued = QueuedStream(pipe.stream, raises=raises)
    queued.write("into nothing\n")
    queued.drain()
    assert isinstance(queued.error, BrokenPipeError)
    if raises:
        with pytest.raises(BrokenPipeError):
            queued.write("more\n")
    else:
        assert queued.write("more\n") == 5


def test_streams_without_a_descriptor_stay_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    with QueuedOutput() as output:
        sys.stdout.write("there at once\n")
        assert out.getvalue() == "there at once\n"
    assert output.error is None


ENDS = """
import sys
from contextlib import suppress
from tools.cli.output_queue import QueuedOutput
with QueuedOutput() as output:
    for stream in (sys.stdout, sys.stderr):
        for number in range(300):
            with suppress(BrokenPipeError):  # raised as soon as the writer has met it
                stream.write(f"{number} " + 999 * "x" + "\\n")
sys.exit(7)
"""


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
@pytest.mark.parametrize("reader", ["none", "full", "left", "closed"])
def test_a_process_exits_with_its_status_for_any_reader(
    stream: str, reader: str, pipe: Pipe
) -> None:
    given = pipe.stream.fileno()
    if reader == "full":
        pipe.fill()
    if reader == "left":
        pipe.leave()
    script = ENDS
    if reader == "closed":
        script = f"import sys\nsys.{stream}.close()\nsys.{stream} = open('/dev/null', 'w')\n" + ENDS
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
        timeout=PATIENCE_S,
        stdout=given if stream == "stdout" else subprocess.DEVNULL,
        stderr=given if stream == "stderr" else subprocess.DEVNULL,
    )
    assert done.returncode == 7
