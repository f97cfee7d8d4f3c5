"""Every compiled kernel of the planner called once, before the robot may move.

A kernel's first call in a process loads its machine code (tens of milliseconds) or, where
installation did not, compiles it (seconds). Neither may happen while setpoints expire.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from bridge.coverage.recovery.choice import Chooser
from bridge.coverage.recovery.evidence import EvidenceMap
from bridge.coverage.recovery.options import RecoveryOptions
from bridge.motion.control.braking import Braking
from bridge.motion.geometry import Pose2
from bridge.motion.observation import Observation

if TYPE_CHECKING:
    from bridge.motion.robot_model import RobotModel

_WAY_M = 0.6
_STEP_M = 0.02
_WALL_M = 0.07
"""What the right infrared reads on the way: a wall beside the lane."""


def rehearse(model: RobotModel) -> None:
    """Call each kernel with the kinds of arguments that a run gives it; no effect is kept.

    Call it before a port is opened for motion. It takes some 0.2 s where installation has
    compiled the kernels, and half a minute where it has not.
    """
    options = RecoveryOptions()
    pose = Pose2(0.0, 0.0, 0.0)
    memory = EvidenceMap(model, options, pose)
    for k in range(round(_WAY_M / _STEP_M)):
        pose = Pose2(k * _STEP_M, 0.0, 0.0)
        memory.update(_seen(pose, 0.1 * k))
    memory.add_bump(pose, left=True, right=False)
    memory.block(pose.x_m + 0.3, 0.0, 0.05)
    memory.give_up(pose.x_m, 0.5, 0.05)
    memory.fresh(pose, (0.03, 0.25), (-0.065, -0.03))
    memory.pace(pose, 0, Braking(0.3, 0.1))
    chooser = Chooser(options)
    for grid_rad in (0.0, 0.3):
        chooser.choose(memory, pose, grid_rad)
    Chooser(replace(options, least_rate=math.inf)).choose(memory, pose, 0.0)
    memory.forget(pose, 0.6, 0.6)
    chooser.choose(memory, pose, 0.25 * math.pi)


def _seen(pose: Pose2, time_s: float) -> Observation:
    return Observation(
        time_s=time_s,
        pose=pose,
        v_m_s=0.2,
        yaw_rate_rad_s=0.0,
        ultrasonic_m=None,
        infrared_left_m=None,
        infrared_right_m=_WALL_M,
        bumper_left=False,
        bumper_right=False,
        cliff=False,
    )
