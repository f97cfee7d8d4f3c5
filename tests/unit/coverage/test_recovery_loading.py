"""A run of the recovery planner imports no module, because an import would delay the robot."""

from __future__ import annotations

import json
import subprocess
import sys

from support.root import ROOT

PROGRAM = """
import json, sys
sys.path.insert(0, "tests")
import numpy as np
from bridge.coverage.registry import make_planner
from bridge.motion.robot_model import RobotModel
from support.fast_world import LEVELS, run_fast
from tools.rooms.generator import generate_room
plan = generate_room(3, np.random.default_rng(3), "legs")
planner = make_planner("recovery", RobotModel(), np.random.default_rng(1))
before = set(sys.modules)
done = run_fast(plan, planner, RobotModel(), seed=1, noise=LEVELS["harsh"], max_time_s=400.0)
ours = sorted(name for name in set(sys.modules) - before if name.startswith("bridge."))
kinds = sorted({event.kind for _, event in done.events})
print(json.dumps({"loaded": ours, "kinds": kinds}))
"""


def test_a_run_loads_nothing_more() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, check=True
    )
    reported = json.loads(done.stdout)
    # the run used every kernel: lanes, perimeters, bumps
    assert {"lane", "perimeter-begin", "obstacle"} <= set(reported["kinds"])
    assert reported["loaded"] == []
