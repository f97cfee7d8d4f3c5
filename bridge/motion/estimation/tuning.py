"""The tuned constants of the estimation."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from bridge.motion.estimation.displacement import DisplacementTuning
from bridge.motion.estimation.disturbance import BridgeTuning, DisturbanceTuning
from bridge.motion.estimation.drift_model import DriftModel
from bridge.motion.estimation.noise_monitor import NoiseTuning
from bridge.motion.estimation.standstill import StandstillTuning
from bridge.motion.estimation.wall_map import WallTuning
from bridge.motion.estimation.wall_measurements import MeasurementTuning


@dataclass(frozen=True, slots=True)
class ContactTuning:
    """Effect of contacts on pose, covariance and wall measurements."""

    bump_sigma_m: float = 0.01
    """Standard deviation of the motion in a contact that the wheels do not measure, m. It is used
    without an accelerometer."""
    bump_sigma_rad: float = math.radians(0.5)
    """Standard deviation of the turn in such a contact, rad."""
    measured_sigma_m: float = 0.0012
    """Standard deviation of this motion if there is an accelerometer, m. It measures hard contacts,
    so the error comes from soft contacts only."""
    measured_sigma_rad: float = math.radians(0.05)
    """Standard deviation of this turn if there is an accelerometer, rad."""
    slide_aside: float = 0.18
    """Sideways motion while one switch is pressed, as a share of the wheels' path. It was measured
    in 700 contacts and is equal at ``typical`` and ``harsh`` noise."""
    slide_ahead: float = 0.05
    """Share of the wheels' path that the robot does not drive forward in these contacts."""
    slide_share: float = 0.1
    """Standard deviation of the remaining error while one switch is pressed, as a share of the
    path."""
    press_share: float = 0.3
    """Standard deviation of the remaining error with both switches pressed, or without an
    accelerometer, as a share of the path."""
    graze_along_m_sqrt_m: float = 0.0007
    """Noise along the heading while the robot grazes a wall at nominal slip, m/√m (our choice).
    Friction slows the robot down."""
    graze_across_m_sqrt_m: float = 0.003
    """Noise across the heading while the robot grazes a wall, m/√m. The wall pushes the robot
    sideways by the path times the angle at which the heading points into the wall. An angle with a
    σ of 0.4° and the correlation length L = ``FollowTuning.lookahead_m`` gives 0.4°·√(2L) = 0.0033.
    In 191 contacts in generated rooms the virtual robot had 0.0026 at ``typical`` noise and 0.0030
    at ``harsh`` (RMS)."""
    reading_m: float = 0.02
    """Maximum path between two readings that counts, m."""
    stuck_m: float = 0.3
    """Maximum path of a contact, m. A switch that stays pressed for longer is stuck."""
    free_readings: int = 4
    """Number of readings without contact that end a contact: 0.15 s."""
    grazing_gap_m: float = 0.005
    """Gap between the rim and a wall beside the robot below which the robot may graze the wall,
    m."""
    strong_graze_gap_m: float = 0.0005
    """Mean gap below which grazing may turn the measured wall direction towards the heading, m."""
    strong_graze_rad: float = math.radians(1.5)
    """Standard deviation of the wall direction with a gap below ``strong_graze_gap_m``, or from
    ``free_gap_m``, rad. Grazing seldom turns the direction, but by up to 1.4°. It affects a
    measurement on the other side of the robot too."""
    light_graze_rad: float = math.radians(0.4)
    """Standard deviation of the wall direction with a gap from ``strong_graze_gap_m`` to
    ``free_gap_m``, rad. Occasional grazing turns the direction by 0.2 to 0.36°."""
    free_gap_m: float = 0.01
    """Minimum gap at which a measured wall cannot be the grazed wall, m."""


@dataclass(frozen=True, slots=True)
class EstimationTuning:
    """Noise, limits and gains of the estimation, in groups.

    In all groups, a value without another source was chosen in runs of the virtual robot at the
    noise levels ``typical`` and ``harsh``.
    """

    speed_lowpass: float = 0.5
    """Weight of the newest interval in the speed. One count in 20 ms is 6.5 mm/s."""
    warming_lowpass: float = 0.02
    """Weight of the newest sample in the low-pass of the temperature, because the register is
    noisy."""
    warming_jump_c: float = 2.0
    """Minimum change of the temperature between samples that means that the device restarted,
    °C."""
    drift: DriftModel = field(default_factory=DriftModel)
    """Process noise and initial uncertainty."""
    noise: NoiseTuning = field(default_factory=NoiseTuning)
    """How the noise grows with vibration and slip."""
    standstill: StandstillTuning = field(default_factory=StandstillTuning)
    """Limits of a standstill, which measures the gyro bias."""
    disturbance: DisturbanceTuning = field(default_factory=DisturbanceTuning)
    """Limits of bumps and slips."""
    bridge: BridgeTuning = field(default_factory=BridgeTuning)
    """Inertial motion after a bump."""
    contact: ContactTuning = field(default_factory=ContactTuning)
    """Effect of contacts."""
    measurements: MeasurementTuning = field(default_factory=MeasurementTuning)
    """Measurements of walls by range sensors."""
    walls: WallTuning = field(default_factory=WallTuning)
    """Association of measurements with walls."""
    displacement: DisplacementTuning = field(default_factory=DisplacementTuning)
    """Detection that the robot was moved."""
