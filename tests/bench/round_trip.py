"""Round trip of a command over a pty through the whole bridge, compared with a bare pyserial echo.

    PYTHONPATH=tests python -m bench.round_trip

Both cases use two Python processes with a pseudo-terminal between them. In the bare case, pyserial
writes as many bytes as a command has. It then reads as many bytes as an acknowledgement has from a
process that echoes. In our case, the time of an acknowledged command is measured, from the
program's request to the program's callback with the result. The command goes through session, link,
pump and recorder. The other end decodes, checks and acknowledges it with the same protocol library.

Both cases send once in a control period of 20 ms, and their rounds alternate. Percentiles are
computed for each round, and the ratio is the median of the rounds' ratios.
"""

from __future__ import annotations

import argparse
import gc
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Self

import serial

from bridge.api.pump import Pump
from bridge.io import clock
from bridge.io.ports import SerialPort
from bridge.motion.robot_model import RobotModel
from bridge.record.log_writer import RunWriter
from bridge.record.recorder import ThreadedRecorder
from bridge.run.ending import Ending
from bridge.run.host import Host
from bridge.run.mission import Mission
from bridge.run.options import HostOptions
from bridge.session.records import RunInfo
from bridge.session.states import State
from protocol.messages.device import Ack
from protocol.messages.host import SetStreamRate
from protocol.schema.message import Direction
from protocol.uart.link import Link

if TYPE_CHECKING:
    from protocol.retransmission import Outcome

FAR_END = Path(__file__).with_name("far_end.py")
WARM = 20
PERIOD_S = 0.02
"""Period of the control loop, s; a program on a robot sends at most one command per period."""
LINK = 0x28
"""Stream whose rate the commands set; any stream is suitable."""


class FarEnd:
    """The other process, on the master's side of a pty."""

    def __init__(self, kind: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, str(FAR_END), kind], stdout=subprocess.PIPE, text=True
        )
        assert self._process.stdout is not None
        self.port = self._process.stdout.readline().strip()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()


def frame_sizes() -> tuple[int, int]:
    """Return the length of the command and of its answer on the line, bytes."""
    host, device = Link(Direction.HOST), Link(Direction.DEVICE)
    host.send(SetStreamRate(1, LINK, 10), 0, node=1)
    device.send(Ack(1, 0x0D), 0, node=1)
    return len(host.data_to_send()), len(device.data_to_send())


def bare(count: int) -> list[int]:
    """Return round trips of the same number of bytes, ns."""
    size, answer = frame_sizes()
    data, took = bytes(range(1, size + 1)), []
    with FarEnd(f"echo:{size}:{answer}") as far, serial.Serial(far.port, 921_600) as port:
        for index in range(WARM + count):
            time.sleep(PERIOD_S)
            begun_ns = time.perf_counter_ns()
            port.write(data)
            if len(port.read(answer)) != answer:
                raise SystemExit("the echo is short")
            if index >= WARM:
                took.append(time.perf_counter_ns() - begun_ns)
    return took


class Asking:
    """A program on the bridge that sends once per period, in the loop's own thread."""

    def __init__(self, host: Host, pump: Pump, count: int) -> None:
        self._host, self._pump, self._count = host, pump, count
        self._begun_ns = 0
        self._answered = threading.Event()
        self.took: list[int] = []

    def run(self) -> None:
        """Send until there are enough round trips; runs in a separate thread."""
        while self._host.session.state is not State.READY:
            time.sleep(PERIOD_S)
        for _ in range(WARM + self._count):
            time.sleep(PERIOD_S)
            self._answered.clear()
            self._pump.call(self._ask)
            self._answered.wait()
        self._pump.request_end(Ending("stopped", "measured", 0))

    def _ask(self) -> None:
        self._begun_ns = time.perf_counter_ns()
        self._host.commands.ask(SetStreamRate, (LINK, 10), clock.now(), self._done)

    def _done(self, outcome: Outcome | None) -> None:
        self.took.append(time.perf_counter_ns() - self._begun_ns)
        if outcome is None or not outcome.accepted:
            raise SystemExit("a command was not accepted")
        self._answered.set()


def ours(count: int, folder: Path) -> list[int]:
    """Return round trips of commands through the whole recorded bridge, ns."""
    offset_ns = clock.unix_offset_ns()
    opened_ns = clock.now() + offset_ns
    info = RunInfo("bench", "", None, "bench", opened_ns, offset_ns, RobotModel(), "")
    recorder = ThreadedRecorder(RunWriter(folder / "run.mcap", info, force=True))
    try:
        with FarEnd("device") as far:
            host = Host(RobotModel(), recorder, HostOptions(offset_ns), Mission(None), lambda: 7)
            port = SerialPort(far.port)
            pump = Pump(host, port, lambda: SerialPort(far.port))
            asking = Asking(host, pump, count)
            thread = threading.Thread(target=asking.run, daemon=True)
            thread.start()
            pump.run()
            thread.join()
    finally:
        recorder.close()
    return asking.took[WARM:]


def percentile(values: list[int], percent: float) -> float:
    """Return a percentile, µs."""
    return sorted(values)[min(len(values) - 1, int(len(values) * percent / 100.0))] / 1000.0


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--rounds", type=int, default=5)
    options.add_argument("--count", type=int, default=300)
    asked = options.parse_args()
    ratios: dict[float, list[float]] = {50.0: [], 99.0: []}
    print("| round | bare p50 | ours p50 | bare p99 | ours p99 |")
    print("|-------|---------:|---------:|---------:|---------:|")
    with tempfile.TemporaryDirectory() as folder:
        for number in range(asked.rounds):
            gc.collect()
            echo = bare(asked.count)
            gc.collect()
            command = ours(asked.count, Path(folder))
            cells = []
            for percent, kept in ratios.items():
                own, peer = percentile(command, percent), percentile(echo, percent)
                kept.append(own / peer)
                cells += [f"{peer:5.0f} us", f"{own:5.0f} us"]
            print(f"| {number + 1:5} | {' | '.join(cells)} |")
    for percent, kept in ratios.items():
        print(f"p{percent:.0f}: {statistics.median(kept):.2f} times the bare echo")


if __name__ == "__main__":
    main()
