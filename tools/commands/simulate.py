"""``sweepctl simulate``: host and virtual sweeper in one process, in virtual time."""

from __future__ import annotations

import contextlib
import signal
import sys
from typing import TYPE_CHECKING, Any

import click

from tools.cli import options, planners
from tools.cli.completion import complete_room
from tools.cli.configuration import ConfiguredOption, given
from tools.cli.console import err, inform, print_error, print_summary
from tools.cli.foxglove import foxglove_option, live_foxglove, run_parameters
from tools.cli.on_event import EventCommands, on_option
from tools.cli.supervising import rule_option

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from bridge.coverage.runner import PlanRunner
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.geometry import Pose2
    from bridge.motion.robot_model import RobotModel
    from bridge.record.sink import Sink
    from bridge.run.ending import Ending
    from bridge.run.host import Host
    from bridge.session.records import RunInfo
    from sim_device.faults.spec import FaultSpec
    from sim_device.line.line import LineSettings
    from tools.virtual.run import VirtualRun


@click.command("simulate", epilog="Example:  sweepctl simulate case-1 --planner paper --json")
@click.argument("room", shell_complete=complete_room)
@click.option(
    "--planner",
    cls=ConfiguredOption,
    type=planners.PlannerName(),
    default=planners.DEFAULT_PLANNER,
    show_default=True,
    help="Planner to run: one of sweepctl, one of a plug-in, or a file of your own.",
)
@click.option(
    "--planner-option",
    "planner_options",
    metavar="NAME=VALUE",
    multiple=True,
    help="Set an option of the planner, in SI units; may be repeated. An unknown name lists all "
    "options.",
)
@options.target_options
@options.seed_option
@options.noise_option
@options.fault_option
@options.baud_option
@options.latency_option
@click.option(
    "--max-time",
    "max_time_s",
    type=options.Number(1.0, 1e6),
    default=3600.0,
    show_default=True,
    metavar="N",
    help="Time limit of the run, in simulated seconds.",
)
@click.option(
    "--supervise",
    is_flag=True,
    help="Run the planner on the device and supervise it from the host.",
)
@rule_option
@click.option(
    "--resume",
    type=click.Choice(["auto", "never"]),
    default="never",
    show_default=True,
    help="After the device was lost and is back: resume the run automatically, or end it.",
)
@click.option(
    "--speed",
    type=options.Number(0.01, 1000.0),
    metavar="FACTOR",
    help="Simulated seconds for each second, for people who watch.  [default: no limit]",
)
@foxglove_option
@on_option
@options.robot_option
@options.start_option
@options.out_option
@options.json_option
def command(  # noqa: PLR0913 - one parameter per option
    *,
    room: str,
    planner: str,
    planner_options: tuple[str, ...],
    target: str,
    firmware: Path | None,
    gdb: bool,
    seed: int,
    noise: str,
    fault: tuple[FaultSpec, ...],
    baud: int | None,
    latency_ms: float | None,
    max_time_s: float,
    supervise: bool,
    rules: tuple[str, ...],
    resume: str,
    speed: float | None,
    foxglove: tuple[str, int] | None,
    on_events: tuple[tuple[str, str], ...],
    robot: Path | None,
    start: Pose2 | None,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Run a planner against the virtual sweeper in ROOM, in virtual time.

    ROOM is a room file or a name (`docs/rooms.md`). Every byte passes through the codec, as on a
    real link.
    """
    from bridge.api.robot_parts import planner_number
    from bridge.config import load_robot, load_supervise
    from bridge.record.log_writer import RunWriter
    from bridge.record.names import VIRTUAL_PORT
    from bridge.run.mission import Resume
    from bridge.run.notices import NoticeSink
    from tools.cli.cautions import caution_lines, caution_records
    from tools.cli.rooms import load_room
    from tools.cli.supervising import supervise_rules
    from tools.virtual import core_target
    from tools.virtual.pace import PacedSink
    from tools.virtual.run import EPOCH_NS, run_virtual
    from tools.virtual.wanted import Wanted

    core_target.check(target, firmware, gdb=gdb, in_real_time=False)
    supervision = supervise_rules(robot, rules) if supervise or rules else None
    model, robot_toml = load_robot(robot)
    plan = load_room(room, model.radius_m, start)
    check_faults(plan, fault, target)
    if supervise and planner_options:
        raise click.UsageError(
            "--planner-option sets a planner on the host; it cannot be used with --supervise"
        )
    if supervise:
        planner = _onboard(planner)
    runner = None if supervise else _runner(model, planner, planner_options, seed)
    said = {
        "noise": noise,
        "faults": " ".join(spec.text for spec in fault),
        "planner_options": " ".join(planner_options),
        "target": "" if target == "python" else target,
        "firmware": "" if firmware is None else firmware.name,
    }
    path = options.log_path(out, plan.name)
    info = _info(plan, planner, seed, (model, robot_toml, said))
    wanted = Wanted(plan=plan, model=model, seed=seed, noise=noise)
    facts = {"port": VIRTUAL_PORT, "log": str(path)}
    parameters = run_parameters(robot_toml, planner=planner, seed=seed, noise=noise)
    with (
        _interruptible() as ended,  # a signal must not interrupt log and summary either
        core_target.running(target, wanted, firmware, inform, ended, gdb=gdb) as device,
        live_foxglove(foxglove, parameters) as publisher,
        contextlib.closing(RunWriter(path, info, force=force, tap=publisher)) as writer,
    ):
        for line in caution_lines(model, plan):
            inform(line)
        for record in caution_records(model, plan, EPOCH_NS):
            writer.write(record)
        with EventCommands(on_events, facts, print_error) as commands:
            notices = NoticeSink(writer, model, load_supervise(robot).battery, commands.notify)
            sink: Sink = notices if on_events else writer
            with _progress(max_time_s) as progress:
                run = run_virtual(
                    plan,
                    model,
                    planner,
                    sink if speed is None else PacedSink(sink, speed),
                    seed=seed,
                    noise=noise,
                    max_time_s=max_time_s,
                    progress=progress,
                    ended=ended,
                    faults=fault,
                    line=_line(baud, latency_ms),
                    runner=runner,
                    onboard=planner_number(planner) if supervise else None,
                    resume=Resume(resume),
                    supervise=supervision,
                    crash_ends=True,
                    device=device,
                )
            summary = _conclude(run, plan, planner, seed, str(path))
            writer.close(summary)
            ending = run.host.mission.ending
            status = ending.exit_status if ending else 1
            if ending is not None:
                notices.finish(ending, status, summary)
            if run.crash is not None and ending is not None:
                print_error(ending.reason)
                core_target.print_trace(run.crash)
            print_summary(summary, as_json=as_json)
    return status


def _onboard(planner: str) -> str:
    """Return the device's planner: the wanted one, or the default in place of a configured one.

    Raises:
        click.UsageError: the device does not have the planner.

    """
    if planner in planners.PLANNERS:
        return planner
    if given("planner"):
        names = ", ".join(planners.PLANNERS)
        raise click.UsageError(f"--supervise: the device has {names}, not {planner!r}")
    return planners.DEFAULT_PLANNER


def _info(
    plan: FloorPlan, planner: str, seed: int, robot: tuple[RobotModel, str, dict[str, str]]
) -> RunInfo:
    """Return the log's metadata; ``robot`` is the model, its file and further entries."""
    from bridge.record.names import VIRTUAL_PORT
    from bridge.session.records import RunInfo
    from tools.version import VERSION
    from tools.virtual.loop import HOST_BOOT_NS
    from tools.virtual.run import EPOCH_NS

    model, robot_toml, said = robot
    return RunInfo(
        VIRTUAL_PORT,
        planner,
        seed,
        VERSION,
        EPOCH_NS,
        EPOCH_NS - HOST_BOOT_NS,
        model,
        robot_toml,
        plan,
        {name: text for name, text in said.items() if text},
    )


def _conclude(
    run: VirtualRun, plan: FloorPlan, planner: str, seed: int, log: str
) -> dict[str, Any]:
    """Return the run's summary; after a crash, the available part of it."""
    from bridge.run.summary import crash_summary
    from tools.virtual.summary import summarise

    try:
        return summarise(run, plan, planner, seed, log)
    except Exception:
        if run.crash is None:
            raise
        return crash_summary(run.host, room=plan.name, planner=planner, seed=seed, log=log)


def _runner(
    model: Any,  # noqa: ANN401 - its class is imported only when needed
    planner: str,
    planner_options: tuple[str, ...],
    seed: int,
) -> PlanRunner:
    """Make the runner of a planner on the host."""
    import random

    from bridge.coverage.runner import PlanRunner

    made = planners.make(planner, model, random.Random(seed), planner_options)
    return PlanRunner(made, model)


def check_faults(plan: FloorPlan, faults: tuple[FaultSpec, ...], target: str) -> None:
    """Before a log is opened, check that device and room support the faults.

    Raises:
        click.BadParameter: the target does not support a fault, or a fault moves an obstacle that
            the room does not have.

    """
    from sim_device.core.core_sweeper import CANNOT
    from sim_device.faults.fault_target import UnknownObstacleError, check_obstacle
    from sim_device.rig import WITHOUT_BUS

    cannot = {**WITHOUT_BUS, **(CANNOT if target == "core" else {})}
    for spec in faults:
        if spec.kind.name in cannot:
            text = f"{spec.text}: {cannot[spec.kind.name]}"
            raise click.BadParameter(text, param_hint="'--fault'")
        try:
            check_obstacle(plan, spec.values)
        except UnknownObstacleError as error:
            raise click.BadParameter(f"{spec.text}: {error}", param_hint="'--fault'") from None


def _line(baud: int | None, latency_ms: float | None) -> LineSettings | None:
    """Return the link of ``--baud`` and ``--latency-ms``; None: a constant delay of 1 ms."""
    if baud is None and latency_ms is None:
        return None
    from sim_device.line.line import DEFAULT_BAUD, DEFAULT_LATENCY_US, LineSettings

    return LineSettings(
        DEFAULT_BAUD if baud is None else baud,
        DEFAULT_LATENCY_US if latency_ms is None else round(1000.0 * latency_ms),
    )


@contextlib.contextmanager
def _interruptible() -> Iterator[Callable[[], Ending | None]]:
    """Make Ctrl-C and SIGTERM end the run in virtual time, instead of the process."""
    from bridge.run.ending import Ending

    asked: list[int] = []
    handlers = {
        number: signal.signal(number, lambda received, _frame: asked.append(received))
        for number in (signal.SIGINT, signal.SIGTERM)
    }

    def ending() -> Ending | None:
        if not asked:
            return None
        name = "Ctrl-C" if asked[0] == signal.SIGINT else signal.Signals(asked[0]).name
        return Ending("stopped", f"ended by {name}", 0)

    try:
        yield ending
    finally:
        for number, handler in handlers.items():
            # The run is ending as requested. Another signal must not interrupt log and summary.
            signal.signal(number, signal.SIG_IGN if asked else handler)


@contextlib.contextmanager
def _progress(max_time_s: float) -> Iterator[Callable[[float, Host], None]]:
    """Show the progress on a terminal; elsewhere print nothing."""
    if not sys.stderr.isatty():
        yield lambda _time_s, _host: None
        return
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=err(), transient=True) as bar:
        task = bar.add_task("starting", total=max_time_s)

        def show(time_s: float, host: Host) -> None:
            runner = host.mission.runner
            state = runner.state.state if runner else ""
            bar.update(
                task,
                completed=time_s,
                description=f"{time_s:6.0f} s simulated, {host.path_m:6.1f} m driven, {state}",
            )

        yield show
