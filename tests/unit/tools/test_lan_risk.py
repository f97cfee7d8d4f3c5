"""Opening a port or a bus to the network prints a warning."""

from __future__ import annotations

import pytest

from tools.cli.lan_risk import bus_risk, port_risk


@pytest.mark.parametrize(
    ("link", "listen", "lan"),
    [
        ("tcp", None, False),
        ("tcp", ("127.0.0.1", 0), False),
        ("tcp", ("::1", 7000), False),
        ("tcp", ("localhost", 0), False),
        ("udpcan", None, False),
        ("pty", None, False),
    ],
)
def test_a_local_port_is_no_risk(link: str, listen: tuple[str, int] | None, *, lan: bool) -> None:
    assert port_risk(link, listen, lan=lan, keyed=False) is None


@pytest.mark.parametrize(
    ("link", "listen", "lan", "who"),
    [
        ("tcp", None, True, "this port"),
        ("tcp", ("0.0.0.0", 0), False, "this port"),  # noqa: S104 - the case of the warning
        ("tcp", ("192.168.1.2", 0), False, "this port"),
        ("tcp", ("robot.lan", 0), False, "this port"),
        ("udpcan", None, True, "this bus"),
    ],
)
def test_a_port_open_to_others_is_reported_with_the_risk(
    link: str, listen: tuple[str, int] | None, who: str, *, lan: bool
) -> None:
    bare = port_risk(link, listen, lan=lan, keyed=False) or ""
    assert f"every machine that reaches {who} over the network can drive the robot" in bare
    assert "--key-file" in bare
    keyed = port_risk(link, listen, lan=lan, keyed=True) or ""
    assert "can stop the robot and read its data" in keyed
    assert "drive" not in keyed


def test_a_host_that_joins_a_network_bus_is_warned_too() -> None:
    bus = "can:udp_multicast:239.74.163.2"
    assert bus_risk(bus, lan=False, keyed=False) is None
    assert bus_risk("/dev/ttyUSB0", lan=True, keyed=False) is None
    assert "drive the robot" in (bus_risk(bus, lan=True, keyed=False) or "")
    assert "forge its data" in (bus_risk(bus, lan=True, keyed=True) or "")
