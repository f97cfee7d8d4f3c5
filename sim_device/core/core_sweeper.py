"""The virtual sweeper with the C firmware on a virtual board."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

from bridge.motion.robot_model import RobotModel
from protocol.can.link import CanLink
from protocol.uart.link import Link
from sim_device.core.chip import LocalChip
from sim_device.core.core_firmware import ChipFlash, CoreFirmware, LineState, answer
from sim_device.core.flash_image import record, set_up
from sim_device.sensors.imu import ImuConfig
from sim_device.sweeper import Sweeper

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from bridge.floor_plan.floor_plan import FloorPlan
    from protocol.link import LinkBase
    from sim_device.core.chip import Chip
    from sim_device.line.device_end import DeviceEnd
    from sim_device.noise import NoiseLevel

CANNOT = MappingProxyType(
    {
        "clock-jump": "the chip reads stamps and deadlines from one counter, which does not jump; "
        "--target python has this fault",
    }
)
"""Kinds of fault that this device rejects, each with the reason."""
_FULL_SCALE = 3
"""Bit offset of the two range bits (FS_SEL, AFS_SEL) in a configuration register."""


class CoreSweeper(Sweeper[CoreFirmware]):
    """A sweeper that runs the C core, or a user's firmware library, on a virtual board."""

    cannot: Mapping[str, str] = CANNOT

    def __init__(  # noqa: PLR0913 - one parameter per option of a device
        self,
        plan: FloorPlan,
        model: RobotModel | None = None,
        *,
        seed: int = 0,
        noise: str | NoiseLevel = "typical",
        node: int = 1,
        link: type[LinkBase] = Link,
        boot_id: int | None = None,
        local: bool = True,
        key: bytes | None = None,
        make_chip: Callable[[Callable[[int], bytes]], Chip] = LocalChip,
    ) -> None:
        """Boot at time 0, at rest at the start pose of the floor plan.

        The core is built for the default robot. So the chip's flash contains the parameters of
        ``model`` that differ from the default robot, and ``key``. If ``local`` is false, no key can
        be set over the link. ``make_chip`` creates a chip with another library or in another
        process. Its argument is the function that answers the chip's requests.

        Raises:
            FloorPlanError: the robot does not fit at its start pose.
            UnknownNoiseLevelError: the noise level does not exist.
            FirmwareLibraryError: the library does not load, or was built for another simulator.

        """
        model = model or RobotModel()
        self._local = local
        self._line: DeviceEnd | None = None
        self._true_us = 0
        self.chip = make_chip(self._answer)
        flash = ChipFlash(self.chip)
        super().__init__(
            plan,
            model,
            flash,
            seed=seed,
            noise=noise,
            node=node,
            link=link,
            boot_id=boot_id,
            imu=_imu_config(self.chip.imu_settings),
        )
        values = set_up(model, key)
        if values:
            flash.write(0, record(values))
        self.firmware = self._new_firmware()

    def close(self) -> None:
        """Release the chip."""
        self.chip.close()

    def attach_line(self, end: DeviceEnd) -> None:
        """Attach the device's end of the link; the chip reads its free space and counters."""
        self._line = end

    def step(self, data: bytes, now_us: int) -> bytes:
        """Advance to ``now_us``, then receive ``data``; return the bytes that the device sends."""
        while self._next_tick_us <= now_us:
            self._period()
        self._true_us = now_us
        return super().step(data, now_us)

    def _period(self) -> None:
        self._true_us = self._next_tick_us
        super()._period()

    def _line_state(self) -> LineState:
        end = self._line
        return LineState() if end is None else LineState(*end.state(self._true_us))

    def _answer(self, what: int) -> bytes:
        return answer(self.sensors, what)

    def _new_firmware(self) -> CoreFirmware:
        if self._line is not None:
            self._line.boot()
        return CoreFirmware(
            self.chip,
            self.sensors,
            self._identity,
            can=issubclass(self.link, CanLink),
            local=self._local,
            line=self._line_state,
        )


def _imu_config(registers: bytes) -> ImuConfig:
    """Return the IMU configuration in the board's registers: SMPLRT_DIV to ACCEL_CONFIG."""
    divider, dlpf, gyro, accel = registers
    return ImuConfig(
        gyro_range_deg_s=250 << (gyro >> _FULL_SCALE & 3),
        accel_range_g=2 << (accel >> _FULL_SCALE & 3),
        dlpf=dlpf & 7,
        divider=divider,
    )
