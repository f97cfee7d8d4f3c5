"""A chip with a firmware library in a child process, so that a crash ends only that process."""

from __future__ import annotations

import os
import re
import select
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from sim_device.core.child import ANSWER, ASKED, OPENED, REPLY, Pipes
from sim_device.core.chip import FirmwareCrashError, FirmwareLibraryError

if TYPE_CHECKING:
    from collections.abc import Callable

PATIENCE_S = 10.0
"""Maximum time of one call, s. A normal call takes microseconds, so a longer call is an endless
loop."""
END_S = 5.0
"""Maximum time for the process to end after the last request, s."""
_TRACER_POLL_S = 0.05
"""Period at which a waiting process looks for a debugger, s."""
_ROOT = Path(__file__).resolve().parents[2]
_TAG = b"sweepctl-core: "
"""Prefix of backtrace lines on stderr: see ``board_virtual/crash.c``."""
_KEPT = 65_536
"""Maximum number of bytes of the latest output that are stored for a crash report."""
_SANITIZERS = re.compile(rb"lib(?:asan|tsan|ubsan)\.so(?:\.\d+)*")
_REPORTED = re.compile(
    r"^(=+\d+=+ *ERROR: .*|.*: runtime error: .*|SUMMARY: .*|.*Assertion .*)$", re.MULTILINE
)
"""Pattern of the lines of a sanitizer or of ``assert`` that describe the crash."""


class CoreProcess:
    """A chip in a child process."""

    def __init__(
        self,
        answer: Callable[[int], bytes],
        library: Path,
        *,
        debugged: bool = False,
        started: Callable[[int], None] = lambda _pid: None,
    ) -> None:
        """Start the process with ``library``.

        ``answer`` answers the chip's requests. ``started`` is called with the process id before the
        first boot. With ``debugged``, a call may take any time.

        Raises:
            FirmwareLibraryError: the file is not a firmware library.
            FirmwareCrashError: the firmware crashed while it was loaded.

        """
        self._answer, self._library, self._debugged = answer, library, debugged
        self._process = subprocess.Popen(  # noqa: S603 - our own module
            [sys.executable, "-P", "-m", "sim_device.core.child", str(library.absolute())],
            env=_environment(library),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,  # Ctrl-C is for this process, which first stops the robot
        )
        process = self._process
        assert process.stdin is not None  # noqa: S101 - Popen was given PIPE
        assert process.stdout is not None  # noqa: S101 - Popen was given PIPE
        self._reading = process.stdout.fileno()
        self._pipes = Pipes(self._reading, process.stdin.fileno())
        self._output = _Output(process)
        kind, payload = self._read()
        if kind != OPENED:
            self.close()
            raise FirmwareLibraryError(library, payload.decode(errors="replace"))
        self.imu_settings = payload
        try:
            started(process.pid)
        except BaseException:
            self.close()
            raise

    @property
    def pid(self) -> int:
        """Id of the process."""
        return self._process.pid

    def call(self, operation: int, payload: bytes) -> bytes:
        """Execute an operation of the chip and return its reply.

        Raises:
            FirmwareCrashError: the process has ended, or does not reply.

        """
        try:
            self._pipes.write(operation, payload)
        except OSError:
            raise self._crash() from None
        kind, reply = self._read()
        while kind == ASKED:
            self._pipes.write(ANSWER, self._answer(reply[0]))
            kind, reply = self._read()
        assert kind == REPLY  # noqa: S101 - our own module at the other end
        return reply

    def close(self) -> None:
        """End the process."""
        process = self._process
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        self._output.end()

    def _read(self) -> tuple[int, bytes]:
        try:
            if not self._debugged and not select.select([self._reading], [], [], PATIENCE_S)[0]:
                self._process.send_signal(signal.SIGABRT)  # the process prints its backtrace
                raise self._crash(f"does not return within {PATIENCE_S:g} s")
            return self._pipes.read()
        except (OSError, EOFError, ValueError):  # ValueError: the pipe is closed
            raise self._crash() from None

    def _crash(self, what: str | None = None) -> FirmwareCrashError:
        """End the process; return the error that describes the crash."""
        self.close()
        text = self._output.text()
        said = _REPORTED.search(text)
        status = self._process.returncode
        if what is None and said is not None:
            what = f"crashed: {said.group().strip()}"
        elif what is None:
            what = f"crashed: {_signal_name(-status)}" if status < 0 else f"called exit({status})"
        trace = _symbolised(self._output.backtrace())
        if trace:
            what += f" in {trace[_first_own(trace, self._library)]}"
        output = text.rstrip() + "\n" if text.strip() else ""
        return FirmwareCrashError(f"the firmware {self._library.name} {what}", output, trace)


class _Output:
    """Output of the process on stderr. It is forwarded at once, except for a backtrace."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stderr is not None  # noqa: S101 - Popen was given PIPE
        self._stream = process.stderr
        self._kept = b""
        self._trace: list[bytes] = []
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        for whole in self._stream:
            line, tag, traced = whole.partition(_TAG)
            if tag:
                self._trace.append(traced.strip())
            if line:
                self._kept = (self._kept + line)[-_KEPT:]
                with suppress(OSError, ValueError):
                    sys.stderr.write(line.decode(errors="replace"))
                    sys.stderr.flush()

    def end(self) -> None:
        """Wait for the rest of the output."""
        self._thread.join(END_S)
        self._stream.close()

    def text(self) -> str:
        """Return the last lines of the output."""
        return self._kept.decode(errors="replace")

    def backtrace(self) -> list[tuple[int, Path]]:
        """Return address and file of each stack frame, the innermost frame first."""
        frames = []
        for line in self._trace:
            address, _, path = line.partition(b" ")
            if address.startswith(b"0x") and path:
                frames.append((int(address, 16), Path(os.fsdecode(path))))
        return frames


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _environment(library: Path) -> dict[str, str]:
    """Return an environment that preloads the library's sanitizers, which must be loaded first."""
    environment = dict(os.environ)
    path = environment.get("PYTHONPATH")
    environment["PYTHONPATH"] = os.pathsep.join([str(_ROOT), path] if path else [str(_ROOT)])
    with suppress(OSError):
        names = sorted({found.decode() for found in _SANITIZERS.findall(library.read_bytes())})
        if names:
            environment["LD_PRELOAD"] = " ".join(names)
            # Python does not free all memory at exit, so leak detection is off.
            environment.setdefault("ASAN_OPTIONS", "detect_leaks=0")
            environment.setdefault("UBSAN_OPTIONS", "print_stacktrace=1")
    return environment


def _symbolised(frames: list[tuple[int, Path]]) -> list[str]:
    """Return function, file and line of each stack frame, by ``addr2line`` if it is installed."""
    program = shutil.which("addr2line")
    lines = []
    for place, (address, path) in enumerate(frames):
        where = address if place == 0 else address - 1  # a return address is behind its call
        text = ""
        if program is not None:
            done = subprocess.run(  # noqa: S603 - found on the path
                [program, "-f", "-p", "-s", "-e", path, hex(where)],
                capture_output=True,
                text=True,
                check=False,
            )
            text = re.sub(r" \(discriminator \d+\)", "", done.stdout.strip())
        known = text and not text.startswith("??")
        lines.append(f"{text} ({path.name})" if known else f"{hex(address)} in {path.name}")
    return lines


def _first_own(lines: list[str], library: Path) -> int:
    """Return the index of the innermost stack frame in the library, not in the C library."""
    ends = (library.name, f"{library.name})")
    own = [place for place, line in enumerate(lines) if line.endswith(ends)]
    return own[0] if own else 0


# ---- debugging ---------------------------------------------------------------------------


def await_debugger(pid: int, ended: Callable[[], object]) -> None:
    """Wait until a debugger has attached to a process (Linux only).

    Raises:
        KeyboardInterrupt: ``ended`` has returned a true value.

    """
    while not _traced(pid):
        if ended():
            raise KeyboardInterrupt
        time.sleep(_TRACER_POLL_S)


def _traced(pid: int) -> bool:
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace")
    found = re.search(r"^TracerPid:\s*(\d+)", status, re.MULTILINE)
    return found is not None and found.group(1) != "0"
