"""``sweepctl reboot``: have a device boot anew."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from tools.cli import options
from tools.cli.console import inform, write_json
from tools.cli.interrupt import set_done
from tools.cli.port_options import PortAsked, keyed_port_options

if TYPE_CHECKING:
    from bridge.api.remote import Reached

BACK_S = 15.0
"""Time for a device to boot and agree anew, seconds: a lost session looks again after 1 s."""
_POLL_S = 0.1
_STILL = frozenset({"waiting", "done"})
"""Phases of a run in which nothing moves and nothing is about to."""


@click.command("reboot", epilog="Example:  sweepctl reboot /dev/ttyUSB0")
@keyed_port_options
@options.json_option
def command(*, port: PortAsked, as_json: bool) -> int:
    """Reboot the device on PORT and wait until it is back.

    Saved parameters that need a reboot then take effect. If another sweepctl owns the port, the
    command goes through it. A reboot is rejected while the robot may move: stop it first.
    """
    from bridge.api.remote import reach

    with reach(port.name, node=port.node, key=port.key, **port.how) as robot:
        before = _at_rest(port.name, robot)
        robot.reboot()
        try:
            after = _awaited(port.name, robot, before)
        except KeyboardInterrupt as error:
            error.add_note("the device took the command and was not back yet")
            raise
        inform(f"{port.name}: the device has rebooted (cause: {after['reset_cause']})")
        if as_json:
            write_json({"port": port.name, "device": after})
        set_done()
    return 0


def _awaited(port: str, robot: Reached, before: dict[str, Any]) -> dict[str, Any]:
    """The device after its boot.

    Raises:
        DeviceLostError: it did not come back.

    """
    from bridge.errors import DeviceLostError
    from bridge.io import clock

    until_ns = clock.now() + round(BACK_S * 1e9)
    while (after := _back(robot, before)) is None:
        if clock.now() > until_ns:
            raise DeviceLostError(
                f"{port}: the device took the command and was not back after {BACK_S:g} s"
            )
        clock.pause(_POLL_S)
    return after


def _at_rest(port: str, robot: Reached) -> dict[str, Any]:
    """The device as it is now.

    Raises:
        CommandRejectedError: it may move.
        DeviceLostError: there is none at the moment.

    """
    from bridge.errors import CommandRejectedError, DeviceLostError

    known = robot.snapshot()
    device: dict[str, Any] | None = known["device"]
    if device is None or known["session"] != "ready":
        raise DeviceLostError(f"{port}: the device is not there (session: {known['session']})")
    if known["run"] not in _STILL:
        reason = f"the robot may move (run: {known['run']}); `sweepctl stop {port}` first"
        raise CommandRejectedError("reboot", reason)
    return device


def _back(robot: Reached, before: dict[str, Any]) -> dict[str, Any] | None:
    """The device after another boot; None: not yet."""
    known = robot.snapshot()
    device: dict[str, Any] | None = known["device"]
    if device is None or known["session"] != "ready" or device["boot_id"] == before["boot_id"]:
        return None
    return device
