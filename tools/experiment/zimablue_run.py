"""Online planners of the package ``zimablue``, run in its simulation with its own robot.

The zimablue robot is wider than ours: 56.6 cm over its corners with a cleaning head of 34 cm,
compared with 32 cm and 16 cm. For a fair comparison, each floor plan is enlarged by the ratio of
the two widths. Every door, gap and table leg is then equally narrow for both robots. zimablue uses
its own robot, sensors, noise, estimator, speeds and contact model. Our metrics measure its coverage
from its true pose, with its head as a segment on the axle. The coverage is the swept share of the
floor that the head can reach. It is given at multiples of the reference time, which is the area
of this floor / (head width · cruise speed). A run ends when its planner ends, or after six times
the reference time.
"""

from __future__ import annotations

import math
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from bridge.errors import BridgeError
from bridge.evaluation.metrics import CoverageMeter
from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from tools.experiment import curves
from tools.experiment.trials import Trial, TrialKind, room_of

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import Polygon

PLANNERS = {"ba_star": "BA*", "epsilon_star": "ε*", "bsa": "BSA", "spiral_stc": "STC"}
"""Names of the planners in the literature, by their names in zimablue."""
_ROBOT = "tracked"
"""Name of the robot in zimablue."""
LONGEST = 6.0
"""Time limit of a run, in multiples of the reference time."""
_SAMPLE_STEPS = 5
"""Number of simulation steps between two recorded poses: 0.1 s."""
_CENTIMETRE_M = 0.01
"""Cell size of the metrics in the original room, m."""


class CompareMissingError(BridgeError):
    """zimablue is not installed."""

    def __init__(self) -> None:
        super().__init__("--zimablue needs the package: pip install 'sweepctl[compare]'")


def check() -> None:
    """Check, before the runs start, that zimablue is installed.

    Raises:
        CompareMissingError: zimablue is not installed.

    """
    if find_spec("zimablue") is None:
        raise CompareMissingError


def zimablue_trials(rooms: list[str], seeds: range, max_time_s: float | None) -> list[Trial]:
    """Return every combination of room, zimablue's planners and seed, with zimablue's noise."""
    return [
        Trial(room, f"zimablue {name}", "its own", seed, max_time_s, TrialKind.ZIMABLUE)
        for room in rooms
        for name in PLANNERS
        for seed in seeds
    ]


def limit_s(trial: Trial, reference_time_s: float) -> float:
    """Return the time limit of a run, s, from its reference time, s."""
    longest_s = LONGEST * reference_time_s
    return longest_s if trial.max_time_s is None else min(longest_s, trial.max_time_s)


def run_zimablue(trial: Trial) -> dict[str, Any]:
    """Run a trial and return the figures of our own runs that zimablue also has.

    Raises:
        CompareMissingError: zimablue is not installed.
        FloorPlanError: the room is invalid.

    """
    check()
    zimablue: Any = import_module("zimablue")
    robot = import_module("zimablue.robot").make_robot(_ROBOT)
    scale = robot.radius / RobotModel().radius_m
    plan = enlarged(room_of(trial.room), scale)
    controller = zimablue.CONTROLLERS.create(trial.planner.split()[1])
    model = replace(
        RobotModel(),
        robot_diameter_m=2.0 * robot.radius,
        cleaning_width_m=robot.swath_width,
        mouth_offset_m=0.0,
        cruise_speed_m_s=controller.tuning.cruise * robot.locomotion.max_speed,
        max_speed_m_s=robot.locomotion.max_speed,
    )
    meter = CoverageMeter(plan, model, scale * _CENTIMETRE_M)
    simulation = zimablue.Simulation(
        pool=_pool(plan),
        robot=robot,
        controller=controller,
        dirt="clean",
        seed=trial.seed,
        record=False,
        start_pose=tuple(plan.start),
    )
    longest_s = limit_s(trial, meter.reference_time_s)
    track = [_pose(simulation)]
    while not controller.finished and track[-1][0] < longest_s:
        for _ in range(_SAMPLE_STEPS):
            simulation.step()
        track.append(_pose(simulation))
    report = meter.measure(track)
    cut = not controller.finished

    return {
        "outcome": "timeout" if cut else "complete",
        "reason": f"not finished after {longest_s:g} s" if cut else "the planner ended",
        "duration_s": round(report.duration_s, 2),
        "path_m": round(report.path_m, 3),
        **{
            key: value if value is None else round(value, 4)
            for key, value in report.coverage.to_dict().items()
        },
        "scale": round(scale, 4),
        "sweepable_m2": round(report.sweepable_m2, 4),
        "reference_time_s": round(report.reference_time_s, 2),
        "path_ratio": round(report.path_ratio, 4),
        "time_ratio": round(report.time_ratio, 4),
        "curve": {
            "coverage": curves.over_time(meter, report, cut=cut),
            "by_path": curves.over_path(meter, report, track, cut=cut),
        },
        "path": curves.thinned([(x / scale, y / scale) for _, x, y, _ in track]),
    }


def enlarged(plan: FloorPlan, scale: float) -> FloorPlan:
    """Return the room with all lengths multiplied by ``scale``."""

    def polygon(corners: Polygon) -> Polygon:
        return tuple((scale * x, scale * y) for x, y in corners)

    start = Pose2(scale * plan.start.x_m, scale * plan.start.y_m, plan.start.theta_rad)
    solids = (*plan.obstacles, *plan.cliffs)  # zimablue has no cliffs; neither robot may enter one
    return FloorPlan(plan.name, polygon(plan.walls), tuple(polygon(o) for o in solids), start)


def _pool(plan: FloorPlan) -> Any:  # noqa: ANN401 - zimablue has no types
    """Return the room as zimablue's model: a pool of constant depth with solids in it."""
    shape: Any = import_module("shapely.geometry").Polygon
    features: Any = import_module("zimablue.pool.features")
    solids = [
        features.Obstacle(name=f"obstacle {index}", polygon=shape(corners))
        for index, corners in enumerate(plan.obstacles)
    ]
    return import_module("zimablue.pool").Pool(
        shape(plan.walls), 1.5, name=plan.name, features=solids
    )


def _pose(simulation: Any) -> tuple[float, float, float, float]:  # noqa: ANN401 - no types
    state = simulation.state
    heading = math.remainder(float(state.heading), math.tau)
    return float(state.time), float(state.x), float(state.y), heading
