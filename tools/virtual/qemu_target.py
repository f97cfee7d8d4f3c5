"""``emulate --target qemu``: the C firmware's binary on an emulated chip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import ExitStack
    from pathlib import Path

    from sim_device.ports.qemu_sweeper import QemuSweeper
    from tools.virtual.wanted import Wanted

SERIAL = {"pty", "tcp"}
"""Links that work with the emulated chip: QEMU's STM32F405 has no CAN."""


def check(target: str, link: str, *, keyed: bool) -> None:
    """Check that the options of the target can be combined.

    Raises:
        click.UsageError: the options cannot be combined.

    """
    if target == "qemu" and link not in SERIAL:
        raise click.UsageError(
            f"--link {link} needs --target python or core: the chip that QEMU emulates has no CAN"
        )
    if target == "qemu" and keyed:
        raise click.UsageError(
            "--key-file needs --target python or core: the chip that QEMU emulates has no key"
        )


def device(
    stack: ExitStack, wanted: Wanted, firmware: Path | None, notify: Callable[[str], None]
) -> QemuSweeper:
    """Start a chip that runs until ``stack`` is closed.

    Without ``firmware`` it runs the reference firmware, which is built if necessary.

    Raises:
        PortUnavailableError: QEMU, the compiler or the firmware is missing or does not work.

    """
    from sim_device.ports.qemu_build import firmware_elf
    from sim_device.ports.qemu_process import find_qemu
    from sim_device.ports.qemu_sweeper import QemuSweeper

    find_qemu()
    made = QemuSweeper(
        firmware or firmware_elf(notify=notify),
        wanted.plan,
        wanted.model,
        seed=wanted.seed,
        noise=wanted.noise,
        node=wanted.node,
        boot_id=wanted.boot_id,
    )
    stack.callback(made.close)
    return made
