"""``sweepctl bringup``: check that everything is connected correctly."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from tools.bringup.session import clear_stop_option, log_options
from tools.cli import options
from tools.cli.console import inform_lines, write_json, write_line
from tools.cli.paths import PathName
from tools.cli.port_options import PortAsked, keyed_port_options

if TYPE_CHECKING:
    from pathlib import Path

    from bridge.bringup.procedure import BringUp
    from bridge.bringup.wheel_step import WheelStep
    from tools.bringup.session import BringupLog

_STEPS = ("first-power", "supply", "rest", "motors", "axes", "sensors", "control")
"""``bridge.bringup.procedure.STEPS``, repeated because that module is imported only by a run."""


@click.command("bringup", epilog="Example:  sweepctl bringup /dev/ttyUSB0 --step motors")
@keyed_port_options
@click.option(
    "--step",
    "steps",
    multiple=True,
    type=click.Choice(_STEPS),
    help="Run only this step; may be repeated.  [default: all but first-power]",
)
@click.option(
    "--plot",
    type=PathName(dir_okay=False),
    help="Write a plot of the wheels' step response (.png, .svg or .pdf; needs the extra `plot`).",
)
@clear_stop_option
@log_options
@options.robot_option
@options.json_option
def command(  # noqa: PLR0913 - one parameter per option
    *,
    port: PortAsked,
    steps: tuple[str, ...],
    plot: Path | None,
    clear_stop: bool,
    log: BringupLog | None,
    robot: Path | None,
    as_json: bool,
) -> int:
    """Check the wiring of the robot on PORT step by step, WHEELS OFF THE FLOOR.

    \b
    first-power  checklist for motors that never ran: staged duties, up to the first failure
    supply       supply voltages and currents
    rest         inertial sensor and encoders at standstill
    motors       which output turns which wheel, which way; encoder signs and sides
    axes         axes of the inertial sensor; you turn the robot by hand
    sensors      each range sensor, bumper switch and cliff sensor
    control      step response of the wheel controller

    The command asks you before it turns a wheel.

    Exit status: 0 everything is correct; 1 something is wired wrongly.
    """  # noqa: D301 - click keeps the lines of a block behind \b
    from bridge.bringup.procedure import USUAL_STEPS, BringUp
    from bridge.bringup.wheel_step import as_text
    from bridge.config import load_robot
    from tools.bringup.session import Terminal, bringup_session

    steps = steps or USUAL_STEPS
    if plot is not None and "control" not in steps:
        raise click.UsageError("--plot needs the step control, which measures what it shows")
    model, text = load_robot(robot)
    if plot is not None:
        _check_plot(plot)
    with bringup_session(port, log, model, text) as session:
        bringup = BringUp(session, Terminal(session), model, clear_stop=clear_stop)
        bringup.run(steps)
    if bringup.steps:
        inform_lines(as_text(bringup.steps))
        if plot is not None:
            _draw(bringup.steps, plot)
    if as_json:
        write_json(_account(bringup, port.name))
    else:
        wrong = [f for f in bringup.findings if f.ok is False]
        skipped = [f for f in bringup.findings if f.ok is None]
        tail = f", {len(skipped)} skipped" if skipped else ""
        write_line(f"{len(wrong)} of {len(bringup.findings)} checks failed{tail}")
    return 0 if bringup.well else 1


def _account(bringup: BringUp, port: str) -> dict[str, Any]:
    return {
        "port": port,
        "ok": bringup.well,
        "findings": [
            {"step": f.step, "ok": f.ok, "text": f.text, "advice": f.advice or None}
            for f in bringup.findings
        ],
        "wheel_steps": [
            {
                "wheel": step.wheel,
                "target_m_s": step.response.target,
                "steady_m_s": step.steady_m_s,
                "rise_s": _finite(step.rise_s),
                "overshoot": step.overshoot,
                "settled_s": _finite(step.settled_s),
                "time_s": step.response.time_s,
                "speed_m_s": step.response.value,
            }
            for step in bringup.steps
        ],
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _check_plot(path: Path) -> None:
    """Check that the plot can be written, before a wheel turns.

    Raises:
        click.UsageError: matplotlib is missing, or does not support the format of the file.

    """
    from importlib.util import find_spec

    from tools.cli.outputs import check_outputs

    if find_spec("matplotlib") is None:
        raise click.UsageError("--plot needs matplotlib: pip install 'sweepctl[plot]'")
    from bridge.view.report.drawing import blank

    if path.suffix[1:] not in blank(1.0, 1.0).canvas.get_supported_filetypes():
        raise click.UsageError(f"--plot {path}: the name must end with .png, .svg or .pdf")
    force = click.get_current_context().params.get("force")  # --force covers the log and the plot
    check_outputs([path], [], force=bool(force))


def _draw(steps: tuple[WheelStep, ...], path: Path) -> None:
    from bridge.errors import BridgeError
    from bridge.view.report.drawing import blank

    figure = blank(7.0, 4.0)
    axes = figure.subplots()
    for step in steps:
        axes.plot(step.response.time_s, step.response.value, label=f"{step.wheel} wheel")
    axes.axhline(steps[0].response.target, color="0.6", linestyle="--", label="setpoint")
    axes.set(xlabel="time since the step, s", ylabel="speed, m/s", title="Wheel step response")
    axes.grid(alpha=0.3)
    axes.legend()
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise BridgeError(f"cannot write {path}: {reason}") from None
