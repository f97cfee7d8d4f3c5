"""Comparison of range readings at rest with the ranges that the room file predicts."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bridge.floor_plan.floor_plan import FloorPlan, parse_floorplan
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.run.start_check import contradictions
from sim_device.noise import noise_level
from sim_device.sensors.rangers import Rangers
from sim_device.world.world import World
from tools.cli.rooms import load_room, shipped_rooms

MODEL = RobotModel()
BOX = parse_floorplan(
    json.dumps({"walls": [[0, 0], [4, 0], [4, 3], [0, 3]], "start": [0.3, 0.3, 0.0]})
)


Distances = tuple[float | None, float | None, float | None]


def readings(
    plan: FloorPlan, pose: Pose2, noise: str = "typical", seed: int = 0
) -> list[Distances]:
    world = World(plan, MODEL)
    rangers = Rangers(MODEL, noise_level(noise), np.random.default_rng(seed))
    return [rangers.read(100 * k, pose, world)[:3] for k in range(3, 14)]


@pytest.mark.parametrize("noise", ["none", "typical", "harsh"])
@pytest.mark.parametrize("room", shipped_rooms())
def test_a_robot_at_the_start_is_not_accused(room: str, noise: str) -> None:
    plan = load_room(room)
    for seed in range(4):
        assert (
            contradictions(plan, MODEL, plan.start, readings(plan, plan.start, noise, seed)) == []
        )


@pytest.mark.parametrize("room", shipped_rooms())
def test_a_start_marked_by_hand_is_near_enough(room: str) -> None:
    plan = load_room(room)
    start = plan.start
    for dx_m, dy_m, turn_rad in ((0.02, 0.02, 0.03), (0.03, 0.0, -0.03), (0.0, 0.03, 0.0)):
        pose = Pose2(start.x_m + dx_m, start.y_m + dy_m, start.theta_rad + turn_rad)
        assert contradictions(plan, MODEL, start, readings(plan, pose)) == []


@pytest.mark.parametrize(
    ("pose", "sensors"),
    [
        (Pose2(2.0, 1.5, 0.0), {"infrared_right"}),
        (Pose2(0.3, 0.3, np.pi / 2), {"infrared_left", "infrared_right"}),
        (Pose2(3.7, 2.7, np.pi), set()),
        (Pose2(0.3, 2.7, 0.0), {"infrared_left", "infrared_right"}),
    ],
    ids=["middle", "turned", "the same corner, turned half", "other corner"],
)
def test_a_robot_elsewhere_is_noticed(pose: Pose2, sensors: set[str]) -> None:
    found = contradictions(BOX, MODEL, BOX.start, readings(BOX, pose))
    assert {text.split()[0] for text in found} >= sensors
    assert bool(found) == bool(sensors)  # corners of equal shape look the same


def test_both_distances_are_named() -> None:
    (front, right) = contradictions(BOX, MODEL, BOX.start, [(1.0, None, None)] * 5)
    assert front == "ultrasonic reads 1.00 m, expected 3.58 m"
    assert right == "infrared_right reads nothing, expected 0.20 m"


def test_single_strange_readings_are_no_contradiction() -> None:
    true: Distances = (3.58, None, 0.20)
    odd: Distances = (0.3, 0.1, None)
    assert contradictions(BOX, MODEL, BOX.start, [true, true, odd, true, odd]) == []
