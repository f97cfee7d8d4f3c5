"""What to tell whoever opens a port or a bus to the network."""

from __future__ import annotations

from bridge.io.ports import is_can
from sim_device.ports.tcp import is_loopback


def port_risk(link: str, listen: tuple[str, int] | None, *, lan: bool, keyed: bool) -> str | None:
    """Of a virtual sweeper's port; None where nobody but this machine reaches it."""
    if not lan and (listen is None or is_loopback(listen[0])):
        return None
    whoever = "joins this bus" if link == "udpcan" else "reaches this port"
    allowed = "stop the robot and hear what it says" if keyed else "drive the robot"
    hint = "" if keyed else "; --key-file lets only those who have the key"
    return f"whoever {whoever} over the network can {allowed}{hint}"


def bus_risk(port: str, *, lan: bool, keyed: bool) -> str | None:
    """Of a bus that a host joins; None where its frames do not leave this machine."""
    if not lan or not is_can(port):
        return None
    allowed = "stop the robot and forge what it says" if keyed else "drive the robot"
    hint = "" if keyed else "; a key lets only those who have it (sweepctl key)"
    return f"whoever is on the network can join this bus and {allowed}{hint}"
