"""``sweepctl reboot``: reboot a device."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from tools.cli import options
from tools.cli.console import inform, write_json
from tools.cli.interrupt import set_done
from tools.cli.port_options import PortAsked, keyed_port_options

if TYPE_CHECKING:
    from bridge.api.remote import ReachableRobot

BACK_S = 15.0
"""Maximum time for a boot and its handshake, s. The session retries every 1 s."""
READY_S = 3.0
"""Maximum time until the session of the port's owner is ready, s."""
_POLL_S = 0.1
"""Period at which the state of the device is polled, s."""
_STILL = frozenset({"waiting", "done"})
"""Phases of a run in which the robot stands still and will not start to move."""


@click.command("reboot", epilog="Example:  sweepctl reboot /dev/ttyUSB0")
@keyed_port_options
@options.json_option
def command(*, port: PortAsked, as_json: bool) -> int:
    """Reboot the device on PORT and wait until it is back.

    Saved parameters that need a reboot take effect. If another sweepctl has the port open, the
    request goes through it. The command is rejected while the robot may move: stop it first.
    """
    from bridge.api.remote import reach

    with reach(port.name, node=port.node, key=port.key, **port.how) as robot:
        before = _at_rest(port.name, robot)
        robot.reboot()
        try:
            after = _awaited(port.name, robot, before)
        except KeyboardInterrupt as error:
            error.add_note("the device accepted the command and was not back yet")
            raise
        inform(f"{port.name}: the device has rebooted (cause: {after['reset_cause']})")
        if as_json:
            write_json({"port": port.name, "device": after})
        set_done()
    return 0


def _awaited(port: str, robot: ReachableRobot, before: dict[str, Any]) -> dict[str, Any]:
    """Wait for the device and return its description after the boot.

    Raises:
        DeviceLostError: the device did not return within ``BACK_S``.

    """
    from bridge.errors import DeviceLostError
    from bridge.io import clock

    until_ns = clock.now() + round(BACK_S * 1e9)
    while (after := _back(robot, before)) is None:
        if clock.now() > until_ns:
            raise DeviceLostError(
                f"{port}: the device accepted the command but was not back after {BACK_S:g} s"
            )
        clock.pause(_POLL_S)
    return after


def _at_rest(port: str, robot: ReachableRobot) -> dict[str, Any]:
    """Return the device's description before the reboot.

    Raises:
        CommandRejectedError: the robot may move.
        DeviceLostError: no device is connected.

    """
    from bridge.errors import CommandRejectedError, DeviceLostError
    from bridge.io import clock

    until_ns = clock.now() + round(READY_S * 1e9)
    while (known := robot.snapshot())["session"] != "ready" and clock.now() < until_ns:
        clock.pause(_POLL_S)  # an owner that was started just before may still negotiate
    device: dict[str, Any] | None = known["device"]
    if device is None or known["session"] != "ready":
        raise DeviceLostError(f"{port}: no device is connected (session: {known['session']})")
    if known["run"] not in _STILL:
        reason = f"the robot may move (run: {known['run']}); run `sweepctl stop {port}` first"
        raise CommandRejectedError("reboot", reason)
    return device


def _back(robot: ReachableRobot, before: dict[str, Any]) -> dict[str, Any] | None:
    """Return the device's description if it has booted since ``before``; else None."""
    known = robot.snapshot()
    device: dict[str, Any] | None = known["device"]
    if device is None or known["session"] != "ready" or device["boot_id"] == before["boot_id"]:
        return None
    return device
