"""``emulate --target qemu``: the firmware's own binary on an emulated chip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import ExitStack
    from pathlib import Path

    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.motion.robot_model import RobotModel
    from sim_device.ports.qemu_sweeper import QemuSweeper

SERIAL = {"pty", "tcp"}


def check(target: str, link: str, firmware: Path | None) -> None:
    """Refuse what does not go together.

    Raises:
        click.UsageError: options exclude each other.

    """
    if target == "qemu" and link not in SERIAL:
        raise click.UsageError(
            f"--link {link} goes with --target python: the chip that QEMU emulates has no CAN"
        )
    if target != "qemu" and firmware is not None:
        raise click.UsageError("--firmware goes with --target qemu")


def device(  # noqa: PLR0913 - what a device is made with
    stack: ExitStack,
    firmware: Path | None,
    plan: FloorPlan,
    model: RobotModel,
    *,
    seed: int,
    noise: str,
    node: int,
    boot_id: int,
    notify: Callable[[str], None],
) -> QemuSweeper:
    """A chip that runs, until ``stack`` is closed; the firmware is built where none is given.

    Raises:
        PortUnavailableError: QEMU, the compiler or the firmware is missing or does not work.

    """
    from sim_device.ports.qemu_build import firmware_elf
    from sim_device.ports.qemu_process import find_qemu
    from sim_device.ports.qemu_sweeper import QemuSweeper

    find_qemu()
    made = QemuSweeper(
        firmware or firmware_elf(notify=notify),
        plan,
        model,
        seed=seed,
        noise=noise,
        node=node,
        boot_id=boot_id,
    )
    stack.callback(made.close)
    return made
