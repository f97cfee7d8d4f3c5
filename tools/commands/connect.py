"""``sweepctl connect``: a live session with a robot."""

from __future__ import annotations

import contextlib
import secrets
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tools import options

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bridge.coverage.floorplan import FloorPlan
    from bridge.host import Host
    from bridge.io.pump import Pump
    from bridge.motion.robot_model import RobotModel
    from bridge.record.recorder import ThreadedRecorder


@click.command(
    "connect",
    epilog="Example:  sweepctl connect /dev/ttyUSB0 --plan paper --out clean.mcap",
)
@click.argument("port")
@click.option(
    "--plan",
    "planner",
    type=click.Choice(options.PLANNERS),
    help="Run this planner on the host: the robot moves.",
)
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(0.1, 1e6),
    help="End in order after this many seconds.",
)
@click.option("--room", help="The room, where it is known: gives coverage and a map.")
@click.option("--node", type=click.IntRange(1, 15), help="Talk to this device only.")
@click.option("--baud", type=click.IntRange(1200, 12_000_000), default=921_600, show_default=True)
@click.option("--dtr", is_flag=True, help="Set DTR (many boards reset on it).")
@click.option("--rts", is_flag=True, help="Set RTS (many boards reset on it).")
@click.option(
    "--clear-stop",
    is_flag=True,
    help="With --plan: also clear a stop that was latched for safety. Look first.",
)
@options.robot_option
@options.out_option
@options.json_option
def command(  # noqa: PLR0913 - one parameter per option
    *,
    port: str,
    planner: str | None,
    duration_s: float | None,
    room: str | None,
    node: int | None,
    baud: int,
    dtr: bool,
    rts: bool,
    clear_stop: bool,
    robot: Path | None,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Open PORT, agree with the robot, record and show it.

    Nothing moves unless --plan asks for it. PORT is a device path, socket://HOST:PORT or
    rfc2217://HOST:PORT.
    """
    from bridge.config import load_robot
    from bridge.coverage.runner import PlanRunner
    from bridge.host import Host, HostOptions
    from bridge.io import clock
    from bridge.io.ports import SerialPort
    from bridge.io.pump import Pump
    from bridge.mission import Mission
    from bridge.motion.geometry import Pose2
    from bridge.record.recorder import ThreadedRecorder
    from bridge.record.writer import RunWriter
    from bridge.telemetry import RoomRecord, RunInfo
    from tools.console import ERR, complain, print_summary
    from tools.live import Teller
    from tools.rooms import load_room
    from tools.version import VERSION

    if clear_stop and planner is None:
        raise click.UsageError("--clear-stop goes with --plan")
    model, robot_toml = load_robot(robot)
    plan = load_room(room) if room else None
    runner = PlanRunner(_planner(planner, model), model) if planner else None

    def open_port() -> SerialPort:
        return SerialPort(port, baud=baud, dtr=dtr, rts=rts)

    opened = open_port()
    try:
        path = options.log_path(out, plan.name if plan else Path(port).name)
        offset_ns = clock.unix_offset_ns()
        opened_ns = clock.now() + offset_ns
        info = RunInfo(
            port, planner or "", None, VERSION, opened_ns, offset_ns, robot_toml, plan
        )
        recorder = ThreadedRecorder(RunWriter(path, info, force=force))
    except BaseException:
        opened.close()
        raise
    if plan is not None:
        recorder.write(RoomRecord(opened_ns, plan))
    teller = Teller(recorder, plain=not ERR.is_terminal)
    start = plan.start if plan else Pose2(0.0, 0.0, 0.0)
    host = Host(
        model,
        teller,
        HostOptions(offset_ns, planner or "", start, node),
        Mission(runner, clear_stop=clear_stop),
        lambda: secrets.randbelow(0xFFFF_FFFE) + 1,
    )
    pump = Pump(host, opened, open_port)
    pump.watch = lambda: _log_failed(recorder)
    if duration_s is not None:
        pump.end_after(duration_s)
    summary: dict[str, Any] | None = None
    try:
        with _asked(pump), _picture(host, teller):
            pump.run()
        if host.poses:
            host.record_map(clock.now())
        summary = _summarise(host, model, plan, planner, str(path))
    finally:
        recorder.close(summary)
    ending = host.mission.ending
    if ending is not None and ending.exit_status:
        complain(f"{port}: {ending.reason}")
    if recorder.error is not None:
        complain(str(recorder.error))
    if recorder.dropped:
        complain(f"{recorder.dropped} records did not reach the log")
    print_summary(summary, as_json=as_json)
    return ending.exit_status if ending else 1


def _planner(name: str, model: RobotModel) -> Any:  # noqa: ANN401 - imported when needed
    import random

    from bridge.coverage.registry import make_planner

    return make_planner(name, model, random.Random(secrets.randbits(64)))


def _log_failed(recorder: ThreadedRecorder) -> Any:  # noqa: ANN401 - imported when needed
    """An end to the run where its log can no longer be written."""
    from bridge.mission import Ending
    from protocol.values import StopCause

    if recorder.error is None:
        return None
    return Ending("fault", f"the log failed: {recorder.error}", 1, StopCause.SUPERVISE)


@contextlib.contextmanager
def _asked(pump: Pump) -> Iterator[None]:
    """Turn signals and the stop key into an orderly end: the robot stops first."""
    from bridge.mission import Ending
    from protocol.values import StopCause
    from tools.keys import on_key

    def interrupted(number: int, _frame: object) -> None:
        name = "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name
        pump.request_end(Ending("stopped", f"ended by {name}", 0))

    def stop_key() -> None:
        pump.request_end(
            Ending("stopped", "stopped by the operator's key", 5, StopCause.OPERATOR)
        )

    numbers = [signal.SIGINT, signal.SIGTERM]
    if sys.platform != "win32":
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, interrupted) for number in numbers}
    try:
        with on_key(" s", stop_key):
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _picture(host: Host, teller: Any) -> Iterator[None]:  # noqa: ANN401 - imported when needed
    from tools.console import ERR
    from tools.live import LivePicture

    if not ERR.is_terminal:
        yield
        return
    picture = LivePicture(host, teller)
    picture.start()
    try:
        yield
    finally:
        picture.stop()


def _summarise(
    host: Host, model: RobotModel, plan: FloorPlan | None, planner: str | None, log: str
) -> dict[str, Any]:
    from bridge.coverage.metrics import CoverageMeter
    from bridge.summary import run_summary

    report = None
    if plan is not None and host.poses:
        runner = host.mission.runner
        meter = CoverageMeter(plan, model)
        report = meter.measure(((t, *pose) for t, pose in host.poses), runner.lane_length_m if runner else 0.0)
    room = plan.name if plan else None
    return run_summary(host, room=room, planner=planner, seed=None, log=log, report=report)

