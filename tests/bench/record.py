"""Cost of recording a full line of 10 000 messages a second, as a share of one core.

``python -m bench.record`` sends IMU frames, as on a 3 Mbaud line, through the link, the clock and
the recorder's thread into a file. The cost is the CPU time of the whole process, divided by the
duration of the line's data.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from bridge.record.policy import RecordOptions, open_log
from bridge.record.reader import LogReader
from bridge.record.recorder import ThreadedRecorder
from bridge.run.recording import HostRecords
from bridge.session.ingest import Ingest
from bridge.session.timesync import TimeSync
from protocol.clock import HostNs
from protocol.link import Received
from protocol.messages.device import Imu
from protocol.schema.message import Direction
from protocol.uart.link import Link
from support.synthetic_run import run_info

RATE_HZ = 10_000
SECONDS = 10
_READ_HZ = 500
"""Rate of reads from the port, Hz."""


def reads() -> list[bytes]:
    """Return the line's bytes, one read at a time."""
    link = Link(Direction.DEVICE)
    made = []
    per_read = RATE_HZ // _READ_HZ
    for read in range(SECONDS * _READ_HZ):
        for i in range(per_read):
            n = read * per_read + i
            link.send(Imu(n % 300, -n % 280, 16384, -900, n % 31, -5, n % 17), n * 100, node=1)
        made.append(link.data_to_send())
    return made


def record(path: Path, pieces: list[bytes], options: RecordOptions) -> tuple[float, int]:
    """Record the data; return the share of a core, and the number of dropped records."""
    recorder = ThreadedRecorder(open_log(path, run_info(), options))
    records, link = HostRecords(recorder, 0, ""), Link(Direction.HOST)
    ingest = Ingest(TimeSync(), 0)
    begun = time.process_time()
    start = time.perf_counter()
    for i, data in enumerate(pieces):
        late = i / _READ_HZ - (time.perf_counter() - start)
        if late > 0:
            time.sleep(late)
        now_ns = HostNs(1_700_000_000_000_000_000 + i * 1_000_000_000 // _READ_HZ)
        records.uart(data, now_ns, outgoing=False)
        for event in link.receive(data, now_ns // 1000):
            if isinstance(event, Received):
                recorder.write(ingest.take(event, now_ns))
    recorder.close()
    return (time.process_time() - begun) / SECONDS, recorder.dropped


def main() -> None:
    """Print the table."""
    pieces = reads()
    with tempfile.TemporaryDirectory() as folder:
        for name, options in (
            ("plain", RecordOptions()),
            ("--fsync", RecordOptions(fsync=True)),
            ("--rotate-mb 5", RecordOptions(rotate_bytes=5_000_000)),
        ):
            path = Path(folder) / f"{name.strip('-').split()[0]}.mcap"
            share, dropped = record(path, pieces, options)
            parts = list(path.parent.glob(f"{path.stem}*.mcap"))
            kept = sum(1 for p in parts for _ in LogReader(p, alone=True).messages({"/device/imu"}))
            print(
                f"{name:<16}{100 * share:5.1f} % of a core, {dropped} dropped, "
                f"{kept} of {RATE_HZ * SECONDS} messages in {len(parts)} files"
            )


if __name__ == "__main__":
    main()
