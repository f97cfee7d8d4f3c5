"""Runs with a perfect pose: the host gets the true pose instead of its estimate."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from bridge.motion.estimation.estimator import PoseEstimator
    from bridge.motion.geometry import Pose2
    from sim_device.rigged import RiggedDevice
    from tools.virtual.run import VirtualRun


class TruePose:
    """The host's estimator, with the true pose instead of the estimated pose."""

    def __init__(self, inner: PoseEstimator, device: RiggedDevice) -> None:
        """Wrap the estimator ``inner``: it gets all measurements and returns all other values."""
        self._inner, self._device = inner, device

    @property
    def pose(self) -> Pose2:
        """True pose at this time."""
        return self._device.plant.pose

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - any attribute of the estimator
        return getattr(self._inner, name)


def give_true_pose(run: VirtualRun) -> None:
    """Give planner and controllers the true pose."""
    run.host.localisation.estimator = cast(
        "PoseEstimator", TruePose(run.host.estimator, run.device)
    )
