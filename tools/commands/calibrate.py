"""``sweepctl calibrate``: gyro, odometry and range sensors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from tools.bringup.calibrating import writing_options
from tools.bringup.session import clear_stop_option, log_options
from tools.cli import options
from tools.cli.console import write_json
from tools.cli.paths import PathName
from tools.cli.port_options import PortAsked, keyed_port_options

if TYPE_CHECKING:
    from pathlib import Path

    from bridge.bringup.applying import Change
    from bridge.bringup.square import SquareResult
    from bridge.bringup.umbmark import Benchmark
    from bridge.motion.robot_model import RangerMount, RobotModel
    from tools.bringup.session import BringupLog

_SENSORS = ("ultrasonic", "infrared-left", "infrared-right")
_DISTANCES_M = {
    "ultrasonic": (0.20, 0.50, 1.00),
    "infrared-left": (0.06, 0.12, 0.20),
    "infrared-right": (0.06, 0.12, 0.20),
}
"""Default distances of the wall from each sensor's face, m, spread over the sensor's range."""


@click.group("calibrate", epilog="Example:  sweepctl calibrate gyro /dev/ttyUSB0")
def command() -> None:
    """Calibrate the gyro, the odometry or the range sensors of a robot.

    Each command shows the changes and asks before it writes them to the robot file and the device.
    """


# ---- gyro -------------------------------------------------------------------------------


@command.command("gyro", epilog="Example:  sweepctl calibrate gyro /dev/ttyUSB0 --robot robot.toml")
@keyed_port_options
@click.option(
    "--seconds",
    "duration_s",
    type=options.Number(2.0, 3600.0),
    default=10.0,
    show_default=True,
    metavar="N",
    help="Duration of the measurement, s.",
)
@writing_options
@log_options
@options.json_option
def _gyro(  # noqa: PLR0913 - one parameter per option
    *,
    port: PortAsked,
    duration_s: float,
    robot: Path | None,
    yes: bool,
    log: BringupLog | None,
    as_json: bool,
) -> int:
    """Measure the gyro bias while the robot stands still. Nothing moves.

    Each run measures the bias again before it starts. The stored bias is the initial estimate, and
    shows how far the bias has drifted since the calibration.
    """
    from bridge.bringup.applying import Change
    from bridge.bringup.gyro import biases, complaint
    from bridge.errors import BridgeError
    from protocol.messages.device import Encoders, Imu
    from tools.bringup.calibrating import load_existing, write_results
    from tools.bringup.session import Terminal, bringup_session

    model, text = load_existing(robot)
    with bringup_session(port, log, model, text) as session:
        person = Terminal(session, yes=yes)
        person.show(f"Let the robot stand still for {duration_s:g} s.")
        turned = session.watch(Encoders)
        readings = session.collect(Imu, duration_s)
        session.unwatch(turned)
        if len({(m.left, m.right) for _, m in turned if isinstance(m, Encoders)}) > 1:
            raise BridgeError(
                "a wheel turned during the measurement; repeat it with a robot at rest"
            )
        found = biases(
            [(t_s, (m.gyro_x_rad_s, m.gyro_y_rad_s, m.gyro_z_rad_s)) for t_s, m in readings]
        )
        for axis in found:
            bias, sure, wander = (
                math.degrees(v) for v in (axis.bias_rad_s, axis.sigma_rad_s, axis.range_rad_s)
            )
            person.show(f"{axis.name}: {bias:+.4f} ±{sure:.4f} °/s, drift {wander:.4f} °/s")
        wrong = complaint(found[2])
        if wrong is not None:
            raise BridgeError(wrong)
        change = Change(
            "gyro_bias", "gyro_bias_rad_s", "rad/s", model.gyro_bias_rad_s, found[2].bias_rad_s
        )
        written = write_results(session, person, [change], robot, text)
    axes = {a.name: {"bias_rad_s": a.bias_rad_s, "sigma_rad_s": a.sigma_rad_s} for a in found}
    _report(as_json, {"gyro": axes, "written": written.to_dict()})
    return 0


# ---- odometry ---------------------------------------------------------------------------


@command.command(
    "odometry",
    epilog="Example:  sweepctl calibrate odometry /dev/ttyUSB0 --robot robot.toml --side 2",
)
@keyed_port_options
@click.option(
    "--side",
    "side_m",
    type=options.Number(0.5, 10.0),
    default=2.0,
    show_default=True,
    metavar="M",
    help="Side length of the square.",
)
@click.option(
    "--runs",
    type=click.IntRange(1, 20),
    default=5,
    show_default=True,
    help="Number of squares in each direction; more average out random errors.",
)
@click.option(
    "--speed",
    "speed_m_s",
    type=options.Number(0.05, 0.5),
    default=0.15,
    show_default=True,
    metavar="M/S",
    help="Driving speed. Keep it low: a wheel that slips spoils the measurement.",
)
@click.option(
    "--straight/--no-straight",
    default=True,
    show_default=True,
    help="First drive a straight line, which gives the mean wheel diameter; squares do not.",
)
@click.option(
    "--verify",
    is_flag=True,
    help="Drive the squares again with the new values, and write them only if the result agrees.",
)
@click.option(
    "--truth",
    type=PathName(),
    metavar="SOCKET",
    help="Control socket of an emulator: read the true pose from it instead of asking for tape "
    "measurements.",
)
@clear_stop_option
@writing_options
@log_options
@options.json_option
def _odometry(  # noqa: PLR0913 - one parameter per option
    *,
    port: PortAsked,
    side_m: float,
    runs: int,
    speed_m_s: float,
    straight: bool,
    verify: bool,
    truth: Path | None,
    clear_stop: bool,
    robot: Path | None,
    yes: bool,
    log: BringupLog | None,
    as_json: bool,
) -> int:
    """Calibrate wheel base and wheel diameters by driving squares (UMBmark): THE ROBOT MOVES.

    Before each square you place the robot on a mark; after it you measure where the robot stands.
    The method is that of Borenstein and Feng (1996); its closed form is then refined with the
    recorded encoder counts. The largest systematic error is shown for the old and the new values.

    Exit status: 0 done; 1 the verification contradicts the new values, and nothing was written.
    """
    from bridge.bringup.square import Asked, ByTape, Squares
    from tools.bringup.calibrating import NOWHERE, ByTruth, load_existing, write_results
    from tools.bringup.session import Terminal, bringup_session

    model, text = load_existing(robot)
    with bringup_session(port, log, model, text) as session:
        person = Terminal(session, yes=yes)
        measure = ByTape(person) if truth is None else ByTruth(truth)
        squares = Squares(session, person, model, measure, clear_stop=clear_stop)
        asked = Asked(
            side_m=side_m, runs=runs, speed_m_s=speed_m_s, straight=straight, verify=verify
        )
        found = squares.run(asked)
        for line in _result_lines(found):
            person.show(line)
        if found.refuted is None:
            changes = _odometry_changes(model, found.model)
            written = write_results(session, person, changes, robot, text)
        else:
            person.show(f"verification failed: {found.refuted}; nothing was written")
            person.show("repeat with more squares (--runs), slower (--speed), on a floor with grip")
            written = NOWHERE
    _report(as_json, {"odometry": _figures(found), "written": written.to_dict()})
    return 0 if found.refuted is None else 1


def _odometry_changes(old: RobotModel, new: RobotModel) -> list[Change]:
    from bridge.bringup.applying import Change

    return [
        Change("wheel_ratio", "wheel_ratio", "ratio", old.wheel_ratio, new.wheel_ratio),
        Change("wheel_base", "wheel_base_m", "m", old.wheel_base_m, new.wheel_base_m),
        Change(
            "wheel_diameter", "wheel_diameter_m", "m", old.wheel_diameter_m, new.wheel_diameter_m
        ),
    ]


def _result_lines(found: SquareResult) -> list[str]:
    correction, first = found.correction, found.first
    lines = []
    if found.scale is not None:
        lines.append(f"straight line: E_s = {found.scale:.5f}")
    lines += [
        f"alpha {math.degrees(first.alpha_rad):+.4f}°, beta {math.degrees(first.beta_rad):+.4f}°",
        f"closed form: E_d = {first.wheel_ratio:.5f}, E_b = {first.base_factor:.5f}",
        f"refined: E_d = {correction.wheel_ratio:.5f}, E_b = {correction.base_factor:.5f}",
        f"before: {_centres(found.before)}",
        f"after:  {_centres(found.after)}",
    ]
    if found.verified is not None:
        lines.append(f"verification: {_centres(found.verified)}")
    return lines


def _centres(b: Benchmark) -> str:
    (x_cw, y_cw), (x_ccw, y_ccw) = b.clockwise, b.counter_clockwise
    return (
        f"E_max,syst {1000 * b.worst_m:.1f} mm (clockwise {1000 * x_cw:+.1f} {1000 * y_cw:+.1f}, "
        f"counter-clockwise {1000 * x_ccw:+.1f} {1000 * y_ccw:+.1f} mm)"
    )


def _figures(found: SquareResult) -> dict[str, Any]:
    def figures(b: Benchmark | None) -> dict[str, Any] | None:
        if b is None:
            return None
        return {
            "worst_m": b.worst_m,
            "clockwise_m": list(b.clockwise),
            "counter_clockwise_m": list(b.counter_clockwise),
        }

    return {
        "straight_scale": found.scale,
        "alpha_rad": found.first.alpha_rad,
        "beta_rad": found.first.beta_rad,
        "closed_form": {"e_d": found.first.wheel_ratio, "e_b": found.first.base_factor},
        "refined": {"e_d": found.correction.wheel_ratio, "e_b": found.correction.base_factor},
        "before": figures(found.before),
        "after": figures(found.after),
        "driven_again": figures(found.verified),
        "refuted": found.refuted,
        "wheel_ratio": found.model.wheel_ratio,
        "wheel_base_m": found.model.wheel_base_m,
        "wheel_diameter_m": found.model.wheel_diameter_m,
    }


# ---- range sensors ----------------------------------------------------------------------


@command.command(
    "range",
    epilog="Example:  sweepctl calibrate range /dev/ttyUSB0 --sensor infrared-left",
)
@keyed_port_options
@click.option(
    "--sensor",
    "sensors",
    multiple=True,
    type=click.Choice(_SENSORS),
    help="Calibrate only this sensor; may be repeated.  [default: all]",
)
@click.option(
    "--at",
    "distances_m",
    multiple=True,
    type=options.Number(0.02, 5.0),
    metavar="M",
    help="Distance of the wall from the sensor's face; give two or three.  [default: 0.2, 0.5 and "
    "1 m for ultrasonic, 0.06, 0.12 and 0.2 m for infrared]",
)
@writing_options
@log_options
@options.json_option
def _range(  # noqa: PLR0913 - one parameter per option
    *,
    port: PortAsked,
    sensors: tuple[str, ...],
    distances_m: tuple[float, ...],
    robot: Path | None,
    yes: bool,
    log: BringupLog | None,
    as_json: bool,
) -> int:
    """Calibrate scale and offset of the range sensors with a tape measure. Nothing moves.

    You hold a flat board at each distance from the sensor's face. One distance gives the offset,
    two or more give the scale too.
    """
    from bridge.bringup.ranging import RangeCalibrationError, fit
    from tools.bringup.calibrating import load_existing, write_results
    from tools.bringup.range_points import measured
    from tools.bringup.session import Terminal, bringup_session

    model, text = load_existing(robot)
    found: dict[str, Any] = {}
    failed: list[str] = []
    changes: list[Change] = []
    with bringup_session(port, log, model, text) as session:
        person = Terminal(session, yes=yes)
        known = {p.name: p.value for p in session.client.list_parameters()}
        for sensor in sensors or _SENSORS:
            name = sensor.replace("-", "_")
            mount: RangerMount = getattr(model, name)
            now = (
                known.get(f"{name}_scale", mount.scale),
                known.get(f"{name}_offset", mount.offset_m),
            )
            try:
                points = measured(session, person, name, distances_m or _DISTANCES_M[sensor])
                if not points:
                    person.show(f"{sensor}: skipped")
                    continue
                result = fit(points, *now)
            except RangeCalibrationError as error:  # the other sensors do not depend on it
                person.show(f"{sensor}: {error}")
                failed.append(name)
                continue
            person.show(
                f"{sensor}: error {1000 * result.before_m:.1f} mm before, "
                f"{1000 * result.after_m:.1f} mm after"
            )
            found[name] = {"points": [p._asdict() for p in points], **result._asdict()}
            changes += _range_changes(name, now, (result.scale, result.offset_m))
        written = write_results(session, person, changes, robot, text) if changes else None
    done = {"range": found, "failed": failed, "written": written.to_dict() if written else None}
    _report(as_json, done)
    return 1 if failed else 0


def _range_changes(name: str, old: tuple[float, float], new: tuple[float, float]) -> list[Change]:
    from bridge.bringup.applying import Change

    return [
        Change(f"{name}_scale", f"{name}.scale", "ratio", old[0], new[0]),
        Change(f"{name}_offset", f"{name}.offset_m", "m", old[1], new[1]),
    ]


def _report(as_json: bool, found: dict[str, Any]) -> None:  # noqa: FBT001 - named as the option
    if as_json:
        write_json(found)
