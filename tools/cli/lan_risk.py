"""Warnings for a port or a bus that is open to the network."""

from __future__ import annotations

from bridge.io.ports import is_can
from sim_device.ports.tcp import is_loopback


def port_risk(link: str, listen: tuple[str, int] | None, *, lan: bool, keyed: bool) -> str | None:
    """Return the risk of a virtual sweeper's port; None if only this machine reaches it."""
    if not lan and (listen is None or is_loopback(listen[0])):
        return None
    place = "this bus" if link == "udpcan" else "this port"
    allowed = "stop the robot and read its data" if keyed else "drive the robot"
    hint = "" if keyed else "; protect it with --key-file"
    return f"every machine that reaches {place} over the network can {allowed}{hint}"


def bus_risk(port: str, *, lan: bool, keyed: bool) -> str | None:
    """Return the risk of a bus that a host joins; None if its frames stay on this machine."""
    if not lan or not is_can(port):
        return None
    allowed = "stop the robot and forge its data" if keyed else "drive the robot"
    hint = "" if keyed else "; protect it with a key (sweepctl key)"
    return f"every machine on the network can join this bus and {allowed}{hint}"


def viewer_risk(host: str) -> str | None:
    """Return the risk of a viewer's server; None if only this machine reaches it."""
    if is_loopback(host):
        return None
    return "every machine that reaches this port over the network can read the robot's data"
