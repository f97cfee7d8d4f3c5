"""CAN bus of UDP datagrams to a multicast group, in python-can's format.

python-can's ``udp_multicast`` binds to every address of the machine and accepts datagrams to any of
these addresses. This bus accepts only datagrams to the group. It accepts datagrams from other
machines only if requested. Programs with python-can's bus can use the same group.
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
"""UDP port of python-can's ``udp_multicast``."""
_DATAGRAM_MAX = 4096
"""Maximum size of a datagram, bytes. A frame needs about 200 bytes."""
_FOREIGN_MAX = 64
"""Maximum number of datagrams from other machines that one receive call skips."""
_MULTICAST_ALL = {socket.AF_INET: 49, socket.AF_INET6: 29}
"""Linux' socket options ``IP_MULTICAST_ALL`` and ``IPV6_MULTICAST_ALL``. They select whether a
socket also receives from groups that other sockets have joined."""
_LEVEL = {socket.AF_INET: socket.IPPROTO_IP, socket.AF_INET6: socket.IPPROTO_IPV6}


class MulticastBus(can.BusABC):
    """A connection to the bus."""

    def __init__(self, group: str, *, lan: bool = False) -> None:
        """Join the group. If ``lan`` is False, no datagram leaves or enters this machine.

        Raises:
            OSError: the group is invalid, or there is no route to it.
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
        except (OSError, ValueError) as error:  # closed by another thread
            raise can.CanOperationError("the multicast group is gone") from error
        try:
            message = unpack_message(data, check=True)
            # python-can checks ranges but not types: 1.0 passes, but cannot be packed.
            operator.index(message.arbitration_id)
            operator.index(message.dlc)
        except Exception as error:
            raise can.CanOperationError("a datagram is not a CAN frame") from error
        return (None if message.is_fd else message), False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 - this send does not wait
        """Send a frame to the group.

        Raises:
            can.CanOperationError: the system rejected the datagram.

        """
        try:
            self._socket.sendto(pack_message(msg), self._group)
        except OSError as error:
            raise can.CanOperationError(error.strerror or str(error)) from error

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._socket.fileno()

    def shutdown(self) -> None:
        """Leave the group and close the socket."""
        super().shutdown()
        self._socket.close()


def _join(group: str, *, hop_limit: int) -> tuple[socket.socket, Any]:
    """Return a socket that receives the group's datagrams, and the address to send to."""
    family, _, _, _, address = socket.getaddrinfo(group, PORT, type=socket.SOCK_DGRAM)[0]
    if not ipaddress.ip_address(address[0]).is_multicast:
        raise OSError(errno.EINVAL, f"{group} is not a multicast group (239.0.0.0/8)")
    joined = socket.socket(family, socket.SOCK_DGRAM)
    try:
        joined.setblocking(False)  # noqa: FBT003 - positional in C
        joined.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if hasattr(socket, "SO_REUSEPORT"):  # like python-can: all sockets must have the same
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
    """Return True if a datagram is from this machine.

    The sender's address is reliable. A system drops datagrams from a network if their sender is one
    of the system's own addresses (RFC 1812 section 5.3.8).
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
    # The system sends to an own address from the same address. Nothing is sent here.
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((plain, PORT, *scope))
        except OSError:
            return False
        return str(probe.getsockname()[0]).partition("%")[0] == plain
