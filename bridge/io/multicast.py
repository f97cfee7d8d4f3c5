"""A CAN bus of UDP datagrams to a multicast group, in python-can's own format.

python-can's ``udp_multicast`` binds to every address of the machine: a datagram to any of them,
from anywhere, is a frame for it. This one takes datagrams to the group alone, and those of other
machines only where it was asked to. Programs that use python-can's can join the bus all the same.
"""

from __future__ import annotations

import errno
import ipaddress
import operator
import platform
import socket
import struct
from contextlib import suppress
from functools import lru_cache
from typing import Any

import can
from can.interfaces.udp_multicast.utils import is_msgpack_installed, pack_message, unpack_message

from bridge.io.readable import readable

PORT = 43113
"""UDP port: that of python-can's ``udp_multicast``."""
_DATAGRAM_MAX = 4096
"""Bytes of one datagram; a frame takes some 200."""
_FOREIGN_MAX = 64
"""Datagrams of other machines that are passed over before somebody else has a turn."""
_MULTICAST_ALL = {socket.AF_INET: 49, socket.AF_INET6: 29}
"""Linux' ``IP_MULTICAST_ALL`` and ``IPV6_MULTICAST_ALL``: groups that other sockets joined."""
_LEVEL = {socket.AF_INET: socket.IPPROTO_IP, socket.AF_INET6: socket.IPPROTO_IPV6}


class MulticastBus(can.BusABC):
    """One program's place on the bus."""

    def __init__(self, group: str, *, lan: bool = False) -> None:
        """Join the group. Nothing leaves this machine, nor comes in from another, unless ``lan``.

        Raises:
            OSError: there is no such group, or no route to it.
            can.CanInterfaceNotImplementedError: the package msgpack is not installed.

        """
        super().__init__(group)
        is_msgpack_installed()
        self._lan = lan
        self._socket, self._group = _join(group, hop_limit=1 if lan else 0)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            ready = readable([self._socket.fileno()], timeout)
            if not ready:
                return None, False
            for _ in range(_FOREIGN_MAX):
                data, sender = self._socket.recvfrom(_DATAGRAM_MAX)
                if self._lan or _is_ours(sender):
                    break
            else:
                return None, False
        except BlockingIOError:
            return None, False
        except (OSError, ValueError) as error:  # closed meanwhile
            raise can.CanOperationError("the multicast group is gone") from error
        try:
            message = unpack_message(data, check=True)
            # python-can checks ranges but no types: 1.0 passes, and packs into no frame.
            operator.index(message.arbitration_id)
            operator.index(message.dlc)
        except Exception as error:
            raise can.CanOperationError("a datagram that is no frame") from error
        return (None if message.is_fd else message), False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 - it never waits
        """Send a frame to the group.

        Raises:
            can.CanOperationError: the system does not take it.

        """
        try:
            self._socket.sendto(pack_message(msg), self._group)
        except OSError as error:
            raise can.CanOperationError(error.strerror or str(error)) from error

    def fileno(self) -> int:
        """Of the socket."""
        return self._socket.fileno()

    def shutdown(self) -> None:
        """Leave the group."""
        super().shutdown()
        self._socket.close()


def _join(group: str, *, hop_limit: int) -> tuple[socket.socket, Any]:
    """A socket that takes datagrams to the group, and the address to send to."""
    family, _, _, _, address = socket.getaddrinfo(group, PORT, type=socket.SOCK_DGRAM)[0]
    if not ipaddress.ip_address(address[0]).is_multicast:
        raise OSError(errno.EINVAL, f"{group} is no multicast group (239.0.0.0/8)")
    joined = socket.socket(family, socket.SOCK_DGRAM)
    try:
        joined.setblocking(False)  # noqa: FBT003 - positional in C
        joined.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if hasattr(socket, "SO_REUSEPORT"):  # as python-can has it: all must agree on it
            joined.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        joined.bind(address)
        packed, level = socket.inet_pton(family, str(address[0])), _LEVEL[family]
        if platform.system() == "Linux":
            with suppress(OSError):
                joined.setsockopt(level, _MULTICAST_ALL[family], 0)
        if family == socket.AF_INET:
            joined.setsockopt(level, socket.IP_MULTICAST_TTL, hop_limit)
            any_interface = struct.pack("@I", socket.INADDR_ANY)
            joined.setsockopt(level, socket.IP_ADD_MEMBERSHIP, packed + any_interface)
        else:
            joined.setsockopt(level, socket.IPV6_MULTICAST_HOPS, hop_limit)
            joined.setsockopt(level, socket.IPV6_JOIN_GROUP, packed + struct.pack("@I", 0))
    except OSError:
        joined.close()
        raise
    return joined, address


def _is_ours(sender: tuple[Any, ...]) -> bool:
    """Whether a datagram came from this machine.

    The sender's address tells: a system drops what comes in from a network under an address of
    its own (RFC 1812 section 5.3.8).
    """
    host, _, *scope = sender
    return _is_own_address(host, tuple(scope))


@lru_cache(maxsize=64)
def _is_own_address(host: str, scope: tuple[int, ...]) -> bool:
    plain = host.partition("%")[0]
    address = ipaddress.ip_address(plain)
    if address.is_loopback:
        return True
    family = socket.AF_INET if address.version == 4 else socket.AF_INET6  # noqa: PLR2004 - IPv4
    # To reach an address of its own the system sends from that address. Nothing is sent here.
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((plain, PORT, *scope))
        except OSError:
            return False
        return str(probe.getsockname()[0]).partition("%")[0] == plain
