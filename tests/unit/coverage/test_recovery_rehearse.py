"""After ``rehearse`` a run of the recovery planner compiles and loads nothing more."""

from __future__ import annotations

import json
import subprocess
import sys

from support.root import ROOT

PROGRAM = """
import json, sys
from bridge.motion.compiled import KERNELS
from bridge.motion.robot_model import RobotModel
from bridge.coverage.recovery.rehearse import rehearse

def known():
    ours = ("bridge.coverage.recovery", "bridge.motion")
    return {k.name: k.kinds is not None for k in KERNELS.values() if k.name.startswith(ours)}

rehearse(RobotModel())
before = known()
import numpy as np
sys.path.insert(0, "tests")
from bridge.coverage.recovery.planner import RecoveryPlanner
from tools.experiment.room_generator import generate_room
from support.fast_world import LEVELS, run_fast
plan = generate_room(3, np.random.default_rng(3), "legs")
done = run_fast(plan, RecoveryPlanner(RobotModel()), RobotModel(), seed=1,
                noise=LEVELS["harsh"], max_time_s=400.0)
kinds = sorted({event.kind for _, event in done.events})
print(json.dumps({"before": before, "after": known(), "kinds": kinds}))
"""


def test_a_run_after_it_compiles_and_loads_nothing_more() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, check=True
    )
    told = json.loads(done.stdout)
    # the run did what needs the kernels: lanes, outlines, bumps
    assert {"lane", "outline-begin", "obstacle"} <= set(told["kinds"])
    entries = {name for name in told["before"] if "._" not in name}
    assert {name.rpartition(".")[2] for name in entries} >= {"travel", "sweep", "scan_lanes"}
    assert [name for name in entries if not told["before"][name]] == []
    assert told["after"] == told["before"]
