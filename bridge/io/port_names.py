"""Check of port names, with corrections of wrong names."""

from __future__ import annotations

import re
from urllib.parse import urlsplit

FORMS = "/dev/ttyUSB0, socket://HOST:PORT, rfc2217://HOST:PORT or can:INTERFACE:CHANNEL"
"""Valid forms of a port name, for error texts."""
CAN_EXAMPLE = "can:socketcan:can0"
_ON_TCP = frozenset({"socket", "rfc2217"})
_TCP_LIKE = _ON_TCP | {"tcp", "telnet"}
_INTERFACES = {
    "slcan": ("slcan", "/dev/ttyACM0"),
    "socketcan": ("socketcan", "can0"),
    "udp_multicast": ("udp_multicast", "239.74.163.2"),
    "udpcan": ("udp_multicast", "239.74.163.2"),
    "virtual": ("virtual", "bench"),
}
"""python-can's interfaces and the emulator's ``udpcan``, each with an example channel."""
_PASSED_ON = frozenset({"spy", "loop", "hwgrep", "alt", "cp2110"})
"""URL schemes of pyserial that refer to another port."""
_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9_+.-]+):(?://)?(.*)", re.DOTALL)
_HIGHEST = 65_535


def tcp_mistake(port: str) -> str | None:
    """Return the error in the address of ``socket://…`` or ``rfc2217://…``; None if valid."""
    scheme, found, rest = port.partition("://")
    if not found or scheme.lower() not in _ON_TCP or _address(rest) is not None:
        return None
    return (
        f"{port} is not a port: {scheme}:// needs a host and a TCP port from 1 to {_HIGHEST}, "
        f"for example {scheme.lower()}://127.0.0.1:5000"
    )


def misspelt(port: str) -> str | None:
    """Return the correction of an invalid port name; None if it may be a device path."""
    if not port:
        return f"an empty text is not a port: use {FORMS}"
    address = _address(port)
    if address is not None:
        return f"{port} is not a port: for TCP use socket://{address}"
    taken = _SCHEME.fullmatch(port)
    if taken is None or taken[1].lower() in _PASSED_ON:
        return None
    return f"{port} is not a port: {_meant(taken[1].lower(), taken[2])}"


def _meant(scheme: str, rest: str) -> str:
    if scheme in _TCP_LIKE:
        known = "rfc2217" if scheme in {"rfc2217", "telnet"} else "socket"
        address = _address(rest)
        return f"for TCP use {known}://{address or f'HOST:PORT, like {known}://127.0.0.1:5000'}"
    if scheme in _INTERFACES:
        interface, channel = _INTERFACES[scheme]
        return f"for a CAN bus use can:{interface}:{rest or channel}"
    return f"use {FORMS}"


def _address(text: str) -> str | None:
    """Return ``HOST:PORT`` from the start of a URL's rest; None if it is missing."""
    try:
        parts = urlsplit(f"//{text}")
        number = parts.port
    except ValueError:
        return None
    if not parts.hostname or number is None or not 1 <= number <= _HIGHEST:
        return None
    host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
    return f"{host}:{number}"
