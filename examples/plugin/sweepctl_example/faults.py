"""A fault of the virtual sweeper: the gyro gets a bias about its vertical axis."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_device.faults.spec import FaultKind, Number

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_device.faults.knobs import Knobs
    from sim_device.faults.spec import Value


def _turn(knobs: Knobs, values: Mapping[str, Value]) -> None:
    x, y, z = knobs.gyro_bias_deg_s
    knobs.gyro_bias_deg_s = (x, y, z + float(values["bias"]))


CLUMSY_GYRO = FaultKind(
    "clumsy-gyro",
    "The gyro measures a yaw rate that is not there.",
    "clumsy-gyro@5:10:bias=3",
    (Number("bias", "yaw rate at rest", "deg/s", 2.0, -20.0, 20.0),),
    _turn,
)
