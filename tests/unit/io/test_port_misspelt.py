"""A misspelt port: the error suggests the intended port, and does not report a missing robot."""

from __future__ import annotations

import pytest

from bridge.errors import PortError
from bridge.io.port_names import FORMS, misspelt, tcp_mistake
from bridge.io.ports import open_port


def reported(name: str) -> str:
    with pytest.raises(PortError) as caught:
        open_port(name).close()
    assert "\n" not in str(caught.value)
    assert caught.value.exit_status == 3
    return str(caught.value)


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("tcp:host", "for TCP use socket://HOST:PORT, like socket://127.0.0.1:5000"),
        ("tcp:127.0.0.1", "for TCP use socket://HOST:PORT, like socket://127.0.0.1:5000"),
        ("tcp:host:notaport", "for TCP use socket://HOST:PORT, like socket://127.0.0.1:5000"),
        ("tcp:127.0.0.1:5000", "for TCP use socket://127.0.0.1:5000"),
        ("tcp://127.0.0.1:5000", "for TCP use socket://127.0.0.1:5000"),
        ("TCP://[::1]:5000", "for TCP use socket://[::1]:5000"),
        ("socket:robot.local:5000", "for TCP use socket://robot.local:5000"),
        ("rfc2217:robot", "for TCP use rfc2217://HOST:PORT, like rfc2217://127.0.0.1:5000"),
        ("127.0.0.1:5000", "for TCP use socket://127.0.0.1:5000"),
        ("robot:5000", "for TCP use socket://robot:5000"),
        ("slcan:/dev/pts/9", "for a CAN bus use can:slcan:/dev/pts/9"),
        ("slcan:", "for a CAN bus use can:slcan:/dev/ttyACM0"),
        ("socketcan:can1", "for a CAN bus use can:socketcan:can1"),
        ("udpcan:239.74.163.2", "for a CAN bus use can:udp_multicast:239.74.163.2"),
        ("udp_multicast://239.74.163.9", "for a CAN bus use can:udp_multicast:239.74.163.9"),
        ("foo:bar", f"use {FORMS}"),
        ("http://robot/", f"use {FORMS}"),
    ],
)
def test_a_misspelt_name_is_answered_with_its_form(name: str, meant: str) -> None:
    assert reported(name) == f"{name} is not a port: {meant}"


@pytest.mark.parametrize(
    "name",
    [
        *("socket://", "socket://127.0.0.1", "socket://127.0.0.1:x", "socket://:5000"),
        *("socket://127.0.0.1:0", "socket://127.0.0.1:99999", "rfc2217://robot"),
    ],
)
def test_an_address_without_a_host_or_a_port_is_reported_before_it_is_opened(name: str) -> None:
    scheme = name.partition(":")[0]
    assert reported(name) == (
        f"{name} is not a port: {scheme}:// needs a host and a TCP port from 1 to 65535, "
        f"for example {scheme}://127.0.0.1:5000"
    )


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("/dev/ttySWEEPER9", "/dev/ttySWEEPER9 does not exist; plug in the robot"),
        ("ttySWEEPER9", "ttySWEEPER9 does not exist; plug in the robot"),
        ("/dev/by-path/pci-0000:00:14.0", "plug in the robot"),
        ("socket://127.0.0.1:1", "cannot open socket://127.0.0.1:1: Connection refused"),
        ("/", "cannot open /: Is a directory"),
        ("can:nothing", "use can:INTERFACE:CHANNEL, for example can:socketcan:can0"),
        ("can:foo:bar", "unknown CAN interface 'foo'; use slcan, socketcan"),
    ],
)
def test_a_valid_port_name_gets_the_actual_error(name: str, text: str) -> None:
    assert text in reported(name)


@pytest.mark.parametrize(
    "name",
    [
        *("/dev/ttyUSB0", "COM3", "loop://", "spy:///dev/ttyUSB0", "hwgrep://0403:6001"),
        *("can:socketcan:can0", "socket://[::1]:5000", "socket://robot:5000?logging=debug"),
    ],
)
def test_a_possible_port_name_is_accepted(name: str) -> None:
    assert tcp_mistake(name) is None


@pytest.mark.parametrize("name", ["/dev/ttyUSB0", "COM3", "loop://", "spy:///dev/ttyUSB0"])
def test_a_path_is_no_misspelling(name: str) -> None:
    assert misspelt(name) is None


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("hwgrep://(", "unterminated"),
        ("loop://?logging=x", "is not a port: 'x'"),
        ("can:socketcand:x", "cannot open can:socketcand:x: "),
    ],
)
def test_any_library_exception_for_a_name_is_one_line(name: str, text: str) -> None:
    assert text in reported(name)
