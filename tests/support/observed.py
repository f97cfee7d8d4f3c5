"""An observation for tests to modify: a robot at rest without obstacles."""

from __future__ import annotations

from bridge.motion.geometry import Pose2
from bridge.motion.observation import Observation

AT_REST = Observation(
    time_s=0.0,
    pose=Pose2(0.0, 0.0, 0.0),
    v_m_s=0.0,
    yaw_rate_rad_s=0.0,
    ultrasonic_m=None,
    infrared_left_m=None,
    infrared_right_m=None,
    bumper_left=False,
    bumper_right=False,
    cliff=False,
)
"""Robot at rest at the origin, without obstacles: ``AT_REST._replace(v_m_s=0.2)``."""
