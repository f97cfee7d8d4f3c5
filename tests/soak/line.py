"""Record a full 3 Mbaud line for minutes in real time; no byte that arrives may be lost.

    PYTHONPATH=tests python -m soak.line --minutes 10

A separate process acts as a device on a pseudo-terminal and fills the line with inertial samples at
300 000 bytes a second. The host is the same as for a real robot, with loop, recorder and log.
Afterwards the log's raw bytes are compared with the sent bytes, by count and by checksum. Threads,
files, processes and memory are compared with their values at the start.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import threading
import time
import zlib
from pathlib import Path

from bridge.api.pump import Pump
from bridge.io import clock
from bridge.io.ports import SerialPort
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.record.log_writer import RunWriter
from bridge.record.reader import LogReader
from bridge.record.recorder import ThreadedRecorder
from bridge.run.host import Host
from bridge.run.mission import Mission
from bridge.run.options import HostOptions
from bridge.session.records import RunInfo
from bridge.view.report.run_data import frames_of
from soak.day import open_files, resident_mb

FEEDER = Path(__file__).with_name("feeder.py")
GROWTH_MB = 48.0
"""Maximum growth of the memory after a tenth of the time, MB. The recorder's queue may fill and
drain."""
_SAMPLE_S = 1.0


def main() -> int:
    """Fill the line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--baud", type=int, default=3_000_000)
    parser.add_argument("--noise", action="store_true", help="damaged frames of 3 bytes instead")
    options = parser.parse_args()
    before = threading.active_count(), open_files(), children()
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "line.mcap"
        bad = _fill(log, options.minutes * 60.0, options.baud, noise=options.noise)
    after = threading.active_count(), open_files(), children()
    reported = zip(("threads", "files", "processes"), before, after, strict=True)
    print(", ".join(f"{what} {was} -> {now}" for what, was, now in reported))
    if after != before:
        bad.append("threads, files or processes were left")
    for what in bad:
        print(f"bad: {what}")
    return 1 if bad else 0


def children() -> int:
    """Return the number of running child processes."""
    return sum(len(p.read_text().split()) for p in Path("/proc/self/task").glob("*/children"))


def _fill(log: Path, seconds: float, baud: int, *, noise: bool) -> list[str]:
    command = [sys.executable, str(FEEDER), str(seconds), str(baud), *(["noise"] if noise else [])]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as feeder:
        try:
            return _record(feeder, log, seconds, noise=noise)
        finally:
            feeder.kill()


def _record(feeder: subprocess.Popen[str], log: Path, seconds: float, *, noise: bool) -> list[str]:
    assert feeder.stdout is not None
    name = feeder.stdout.readline().strip()
    model = RobotModel()
    offset_ns = clock.unix_offset_ns()
    info = RunInfo(name, "", None, "soak", clock.now() + offset_ns, offset_ns, model, "")
    recorder = ThreadedRecorder(RunWriter(log, info))
    options = HostOptions(offset_ns, "", Pose2(0.0, 0.0, 0.0))
    host = Host(model, recorder, options, Mission(None), lambda: 0x5EED)
    pump = Pump(host, SerialPort(name), lambda: SerialPort(name))
    pump.end_after(seconds + 2.0)
    memory: list[float] = []
    done = threading.Event()
    sampler = threading.Thread(target=_sample, args=(memory, done))
    sampler.start()
    cpu_s, wall_s = time.process_time(), time.monotonic()
    pump.run()
    cpu_s, wall_s = time.process_time() - cpu_s, time.monotonic() - wall_s
    done.set()
    sampler.join()
    recorder.close({})
    ending = host.mission.ending
    early = wall_s < seconds
    if early:
        print(f"the feeding process: {feeder.poll()}")
        for event in (m.decoded for m in LogReader(log).messages({"/events"})):
            print(f"  {event.source} {event.kind}: {event.text}")
        return [f"the host ended after {wall_s:.0f} s: {ending.reason if ending else 'no reason'}"]
    sent, checksum = feeder.communicate(timeout=60.0)[0].split()[-2:]
    warm = memory[len(memory) // 10]
    print(
        f"{wall_s:.0f} s, {int(sent)} bytes sent, {host.session.link.statistics.frames_in} frames, "
        f"{100.0 * cpu_s / wall_s:.0f} % of a core, memory {warm:.0f} -> {memory[-1]:.0f} MB, "
        f"highest {max(memory):.0f}"
    )
    bad = [] if feeder.returncode == 0 else ["the feeding process failed"]
    if memory[-1] - warm > GROWTH_MB:
        bad.append(f"memory grew by {memory[-1] - warm:.0f} MB")
    back = sum(e.decoded.kind == "same_boot" for e in LogReader(log).messages({"/events"}))
    if back:
        bad.append(f"the session was lost and back {back} times: an end was not let run")
    if recorder.dropped or recorder.error:
        bad.append(f"{recorder.dropped} records dropped, {recorder.error}")
    statistics = host.session.link.statistics
    if statistics.lost or (statistics.damaged and not noise):
        bad.append(f"{statistics.lost} frames lost, {statistics.damaged} damaged")
    found = [m.decoded for m in LogReader(log).messages({"/events"})]
    reported = [frames_of(e.data_json) for e in found if e.kind == "damaged"]
    print(f"{statistics.damaged} damaged frames in {len(reported)} records")
    if sum(reported) != statistics.damaged:
        bad.append(f"{sum(reported)} of {statistics.damaged} damaged frames are on record")
    return bad + _compare(log, int(sent), int(checksum))


def _compare(log: Path, sent: int, checksum: int) -> list[str]:
    """Compare the log's raw bytes with the count and checksum that the feeder reports."""
    reader = LogReader(log)
    count = crc = 0
    for message in reader.messages({"/raw/uart/rx"}):
        data = bytes(message.decoded.data)
        count += len(data)
        crc = zlib.crc32(data, crc)
    print(f"{log.stat().st_size / 1e6:.0f} MB of log, {count} bytes of the line in it")
    bad = [] if (count, crc) == (sent, checksum) else [f"log has {count} of {sent} bytes"]
    if reader.truncated or reader.problems:
        bad.append(f"log: truncated {reader.truncated}, {reader.problems[:2]}")
    return bad


def _sample(memory: list[float], done: threading.Event) -> None:
    while not done.wait(_SAMPLE_S):
        memory.append(resident_mb())


if __name__ == "__main__":
    sys.exit(main())
