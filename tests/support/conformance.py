"""The conformance suite in pytest: its devices, its order and its report.

With ``--port`` every check runs on the device of that port, one after the other, and no other test
runs. Without ``--port`` the checks run on several emulated devices in parallel, because checks
mostly wait. Each emulated device is a separate process.
"""

from __future__ import annotations

import queue
import signal
import subprocess
import sys
import tempfile
import threading
from concurrent.futures import Future
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import pytest

from bridge.errors import PortError
from bridge.io.ports import DEFAULT_BAUD, open_port
from protocol.messages.device import Hello
from protocol.messages.host import HostHello
from protocol.schema.catalogue import CATALOGUE
from support.conformance_report import Report, describe_device, kind_of
from support.hold_up import Busy
from support.probe import Probe, now_us
from tools.cli.keyfile import KeyFileError, read_key

if TYPE_CHECKING:
    from collections.abc import Generator

    from protocol.messages.device import Hello as HelloMessage

FOLDER = Path(__file__).resolve().parents[1] / "conformance"
ROOT = FOLDER.parents[1]
FLOOR = FOLDER / "floor.json"
LANES = {
    "pty": 3,
    "slcan": 1,
    "core-pty": 3,
    "core-slcan": 1,
    "keyed-pty": 1,
    "keyed-slcan": 1,
    "keyed-core-pty": 1,
    "keyed-core-slcan": 1,
}
"""Number of emulated devices for each kind of device. A kind has a key or none, its firmware is the
Python model or the C core, and its link is a UART or CAN.
"""
KEYED = "keyed-"
KEY = bytes(range(0x10, 0x20))
"""Key of the emulated devices that have one."""
LISTEN_S = 3.5
"""Time to listen for a device, s. After the end of a session, a device sends three hellos in this
time.
"""
HELD_UP_US = 500_000
"""Minimum delay of the probe or the device that makes a failed check invalid, µs: half of the
device's session timeout.
"""
TRIES = 3
"""Maximum number of tries of a check on an emulated device if such a delay makes the check invalid.
"""
NOT_APPLICABLE = "not applicable: "


# ---- options ----------------------------------------------------------------------------


def add_options(parser: pytest.Parser) -> None:
    group = parser.getgroup("device conformance")
    group.addoption(
        "--port",
        help="run the device conformance suite, and nothing else, against the device at PORT: "
        "a device path, socket://HOST:PORT, or can:INTERFACE:CHANNEL",
    )
    group.addoption("--node", type=int, metavar="N", help="the device's node, of several")
    group.addoption(
        "--key-file", type=Path, metavar="FILE", help="the device's key; the probe signs with it"
    )
    group.addoption("--baud", type=int, default=DEFAULT_BAUD, help="of a serial port")
    group.addoption("--bitrate", type=int, metavar="N", help="of a CAN bus")
    group.addoption(
        "--allow-motion",
        action="store_true",
        help="also run the checks that turn the wheels; lift them off the floor first",
    )
    group.addoption(
        "--conformance-report", type=Path, metavar="FILE.json", help="write the outcome here"
    )


def port_of(config: pytest.Config) -> str | None:
    value: str | None = config.getoption("--port")
    return value


def kind_of_item(item: pytest.Function) -> str:
    return kind_of(str(item.callspec.params["device"]))


def is_slow(item: pytest.Function) -> bool:
    return item.get_closest_marker("slow") is not None


def is_keyed(item: pytest.Function) -> bool:
    return item.get_closest_marker("keyed") is not None


def in_suite(path: Path) -> bool:
    return FOLDER in path.parents


# ---- devices ----------------------------------------------------------------------------


class Emulated:
    """``sweepctl emulate`` in a separate process."""

    def __init__(self, kind: str, seed: int, key_file: Path) -> None:
        device = kind.removeprefix(KEYED)
        target = "core" if "-" in device else "python"
        key = ("--key-file", str(key_file)) if kind.startswith(KEYED) else ()
        self._process = subprocess.Popen(
            [
                *(sys.executable, "-m", "tools.sweepctl", "emulate", str(FLOOR)),
                *("--target", target, "--link", device.removeprefix("core-")),
                *("--seed", str(seed), *key),
            ],
            cwd=ROOT,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def port(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line.startswith("ready "), self._process.communicate()
        return line.removeprefix("ready ").strip()

    def end(self) -> None:
        self._process.send_signal(signal.SIGTERM)
        _, err = self._process.communicate(timeout=30)
        assert self._process.returncode == 0, err


def open_probe(name: str, config: pytest.Config, key: bytes | None) -> Probe:
    """Open a port with these options; sign with ``key`` if it is given.

    Raises:
        PortError: it cannot be opened.

    """
    port = open_port(name, baud=config.getoption("--baud"), bitrate=config.getoption("--bitrate"))
    return Probe(port, node=config.getoption("--node"), key=key)


def identify(probe: Probe) -> HelloMessage | str:
    """Return the device's hello; a line for people if there is not exactly one device."""
    found: dict[int, HelloMessage] = {}
    end_us = now_us() + round(LISTEN_S * 1e6)
    wanted, probe.node = probe.node, None
    while now_us() < end_us and not found:
        probe.send(HostHello(CATALOGUE.hash, 0x00C0FFEE, 0, 0, "conformance"), node=wanted or 0)
        probe.listen(0.4, alive=False)
        for received in probe.received:
            if isinstance(received.message, Hello) and wanted in {None, received.frame.node}:
                found[received.frame.node] = received.message
    if not found:
        who = "nothing" if wanted is None else f"no device of node {wanted}"
        came = f"{len(probe.raw)} bytes came" if probe.raw else "no byte came"
        return f"{who} answers a hello on {probe.port.name} within {LISTEN_S:g} s ({came})"
    if len(found) > 1:
        return f"several devices answer, nodes {sorted(found)}: choose one with --node N"
    ((probe.node, hello),) = found.items()
    return hello


# ---- running ----------------------------------------------------------------------------


def run_check(item: pytest.Function, probe: Probe) -> None:
    """Run one check in a session of its own."""
    probe.forget()
    probe.session_id = 0
    parameters = item.callspec.params if hasattr(item, "callspec") else {}
    own = {name: value for name, value in parameters.items() if name != "device"}
    item.obj(device=probe, **own)


class Lane:
    """One emulated device at a time, which runs one check after the other."""

    def __init__(self, kind: str, seed: int, config: pytest.Config, key_file: Path) -> None:
        self._made = kind, seed, key_file
        self._config = config
        self._key = KEY if kind.startswith(KEYED) else None
        self._emulated = Emulated(*self._made)
        self._probe: Probe | None = None

    def run_fairly(self, item: pytest.Function) -> None:
        """Run one check; if the machine delayed it, repeat it on a new device.

        Device and host are processes that share cores with the rest of the tests. If one of them
        is delayed for most of a second, the device rightly ends the session. The check then fails
        without a fault of the device, and may leave a parameter changed. A wrong device fails
        again.
        """
        for left in range(TRIES - 1, -1, -1):
            if self._probe is None:
                self._probe = open_probe(self._emulated.port(), self._config, self._key)
            busy = Busy()
            try:
                run_check(item, self._probe)
            except AssertionError:
                if not left or (self._probe.held_up_us < HELD_UP_US and not busy.excuses):
                    raise
                self.close()
                self._emulated = Emulated(*self._made)
            else:
                return

    def close(self) -> None:
        """Close the port and end the device."""
        if self._probe is not None:
            self._probe.port.close()
            self._probe = None
        self._emulated.end()


class Lanes:
    """Emulated devices, and the checks that wait for one."""

    def __init__(self, items: list[pytest.Function], config: pytest.Config) -> None:
        self._futures: dict[str, Future[None]] = {}
        self._lanes: list[Lane] = []
        self._threads: list[threading.Thread] = []
        self._end = threading.Event()
        self._folder = tempfile.TemporaryDirectory()
        key_file = Path(self._folder.name) / "robot.key"
        key_file.touch(mode=0o600)
        key_file.write_text(KEY.hex(), encoding="ascii")
        for link, lanes in LANES.items():
            waiting: queue.SimpleQueue[pytest.Function] = queue.SimpleQueue()
            mine = [i for i in items if i.callspec.params["device"] == link]
            # The slowest first; otherwise one lane would finish long after the others.
            for item in sorted(mine, key=is_slow, reverse=True):
                self._futures[item.nodeid] = Future()
                waiting.put(item)
            for seed in range(min(lanes, len(mine))):
                lane = Lane(link, seed, config, key_file)
                self._lanes.append(lane)
                thread = threading.Thread(target=self._work, args=(lane, waiting))
                thread.start()
                self._threads.append(thread)

    def _work(self, lane: Lane, waiting: queue.SimpleQueue[pytest.Function]) -> None:
        while not self._end.is_set():
            try:
                item = waiting.get_nowait()
            except queue.Empty:
                break
            future = self._futures[item.nodeid]
            try:
                lane.run_fairly(item)
            except BaseException as error:  # noqa: BLE001 - belongs to the check's own thread
                future.set_exception(error)
            else:
                future.set_result(None)

    def result(self, item: pytest.Function) -> None:
        """Wait for a check; raise its exception."""
        self._futures[item.nodeid].result()

    def close(self) -> None:
        self._end.set()
        for thread in self._threads:
            thread.join()
        for lane in self._lanes:
            lane.close()
        self._folder.cleanup()


# ---- the plugin -------------------------------------------------------------------------


class ConformancePlugin:
    """Connects the suite with pytest."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._port = port_of(config)
        self._key: bytes | None = None
        self._probe: Probe | None = None
        self._lanes: Lanes | None = None
        self.report = Report()

    # ---- selection

    def pytest_ignore_collect(self, collection_path: Path) -> bool | None:
        if self._port is None or collection_path.is_dir() or in_suite(collection_path):
            return None
        return True

    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        if "device" in metafunc.fixturenames and in_suite(Path(metafunc.module.__file__ or "")):
            links = tuple(LANES) if self._port is None else (self._port,)
            metafunc.parametrize("device", links, indirect=True)

    @pytest.hookimpl(tryfirst=True)  # before a choice by markers
    def pytest_collection_modifyitems(
        self, config: pytest.Config, items: list[pytest.Item]
    ) -> None:
        left_out: list[pytest.Item] = []
        still = self._port is not None and not config.getoption("--allow-motion")
        for item in items:
            if not isinstance(item, pytest.Function) or not in_suite(item.path):
                continue
            item.add_marker("realtime")
            kinds = {mark.args[0] for mark in item.iter_markers("link")}
            if kinds and kind_of_item(item) not in kinds:
                left_out.append(item)
                if self._port is not None:
                    self.report.note(item, "not_applicable", f"only over {min(kinds)}")
            elif not self._fits_key(item):
                left_out.append(item)
                if self._port is not None:
                    self.report.note(item, "not_applicable", "only with a key: --key-file")
            elif self._port is None and kind_of_item(item) == "can" and is_slow(item):
                left_out.append(item)  # seconds of waiting that do not depend on the link
            elif still and item.get_closest_marker("motion"):
                left_out.append(item)
                self.report.note(item, "not_run", "it turns the wheels: --allow-motion")
        items[:] = [i for i in items if i not in left_out]
        config.hook.pytest_deselected(items=left_out)

    def _fits_key(self, item: pytest.Function) -> bool:
        """Return whether a check suits the device.

        An emulated device with a key runs only the checks that need one.
        """
        if self._port is not None:
            return self._key is not None or not is_keyed(item)
        return is_keyed(item) is str(item.callspec.params["device"]).startswith(KEYED)

    def pytest_sessionstart(self) -> None:
        if self._port is None or self._config.getoption("--collect-only"):
            return
        try:
            self._key = read_key(self._config.getoption("--key-file"))
            self._probe = open_probe(self._port, self._config, self._key)
        except (KeyFileError, PortError) as error:
            raise pytest.UsageError(str(error)) from None
        hello = identify(self._probe)
        if isinstance(hello, str):
            self._probe.port.close()
            raise pytest.UsageError(hello)
        self.report.device = describe_device(hello, self._probe.node, self._port)

    def pytest_report_header(self) -> list[str]:
        if self._port is None:
            return []
        lines = [f"device conformance: {self._port}"]
        if self._config.getoption("--allow-motion"):
            lines.append("THE WHEELS WILL TURN: the robot must stand with its wheels off the floor")
        else:
            lines.append("moving checks are off: nothing turns the wheels without --allow-motion")
        return lines

    @pytest.hookimpl(tryfirst=True)
    def pytest_pyfunc_call(self, pyfuncitem: pytest.Function) -> bool | None:
        if not in_suite(pyfuncitem.path) or "device" not in pyfuncitem.fixturenames:
            return None
        if self._probe is not None:
            self._check(pyfuncitem, self._probe)
            return True
        if self._lanes is None:
            chosen = [
                i
                for i in pyfuncitem.session.items
                if isinstance(i, pytest.Function)
                and in_suite(i.path)
                and "device" in i.fixturenames
            ]
            self._lanes = Lanes(chosen, self._config)
        self._lanes.result(pyfuncitem)
        return True

    def _check(self, item: pytest.Function, probe: Probe) -> None:
        """Run one check; if it fails because the device is gone, skip the others."""
        try:
            run_check(item, probe)
        except PortError as error:
            self._lost(item, str(error))
        except Exception:
            try:
                hello = identify(probe)
            except PortError as error:
                hello = str(error)
            if isinstance(hello, str):
                self._lost(item, hello)
            raise

    def _lost(self, item: pytest.Function, why: str) -> NoReturn:
        text = f"the device was lost during {item.name}: {why}; the checks after it were not run"
        self.report.note(item, "failed", text)
        pytest.exit(text, returncode=4)

    # ---- results

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        if in_suite(item.path) and (call.when == "call" or report.failed):
            self._note(item, report)
        return report

    def _note(self, item: pytest.Item, report: pytest.TestReport) -> None:
        if report.passed:
            self.report.note(item, "passed")
        elif report.skipped and isinstance(report.longrepr, tuple):
            reason = report.longrepr[2].removeprefix("Skipped: ").removeprefix(NOT_APPLICABLE)
            self.report.note(item, "not_applicable", reason)
        else:
            self.report.note(item, "failed", report.longreprtext.strip().splitlines()[-1])

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self._port is None or not self.report.chapters:
            return
        device, write = self.report.device, terminalreporter.write_line
        terminalreporter.section("device conformance")
        if device:
            write(
                f"{device['name']} {device['version']}, node {device['node']}, "
                f"uid {device['uid']}, on {self._port}"
            )
        columns = ("passed", "failed", "not applicable", "not run")
        width = max(map(len, self.report.chapters))
        write(" " * width + "".join(f"{name:>16}" for name in columns))
        for title, chapter in self.report.chapters.items():
            values = vars(chapter).values()
            write(f"{title:<{width}}" + "".join(f"{value:>16}" for value in values))
        if any(chapter.not_run for chapter in self.report.chapters.values()):
            write("moving checks were off: with the wheels off the floor, --allow-motion runs them")
        for check in self.report.checks:
            if check["outcome"] == "not_applicable":
                write(f"not applicable: {check['check']}: {check['reason']}")

    def pytest_sessionfinish(self) -> None:
        if self._lanes is not None:
            self._lanes.close()
        if self._probe is not None:
            self._probe.port.close()
        path: Path | None = self._config.getoption("--conformance-report")
        if path is not None and self.report.chapters:
            path.write_text(self.report.as_json(self._port), encoding="utf-8")


def configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "motion: turns the wheels")
    config.addinivalue_line("markers", "slow: waits for seconds; begun first")
    config.addinivalue_line("markers", "keyed: needs a device with a key")
    config.addinivalue_line("markers", "link(kind): only over this kind of link, uart or can")
    config.pluginmanager.register(ConformancePlugin(config), "device-conformance")
