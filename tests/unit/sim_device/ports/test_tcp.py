"""The emulator's TCP port accepts one host, and a stop from any other client."""

from __future__ import annotations

import select
import socket
from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest

from protocol.link import Received
from protocol.messages.host import HostHello, SetMode, Stop, TimeRequest, VelocitySetpoint
from protocol.messages.values import Mode, StopCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.link import Link
from sim_device.ports import TcpServerPort

if TYPE_CHECKING:
    from collections.abc import Iterator

    from protocol.schema.message import Message

PATIENCE_S = 30.0
STOP = Stop(7, StopCause.OPERATOR)
HELLO = HostHello(CATALOGUE.hash, 9, 0, 0, "test")


class Served:
    """The port, and the messages that it receives."""

    def __init__(self, port: TcpServerPort) -> None:
        self.port = port
        self.link = Link(Direction.DEVICE)
        self.received: list[Message] = []

    def turn(self, limit: int = 4096) -> None:
        """Wait for bytes of a client, and read them."""
        ready, _, _ = select.select(self.port.filenos(), [], [], PATIENCE_S)
        assert ready, "no bytes arrived"
        data = self.port.read(limit)
        assert len(data) <= limit
        self.received += [e.message for e in self.link.receive(data) if isinstance(e, Received)]

    def until(self, message: Message) -> None:
        while message not in self.received:
            self.turn()

    def connect(self, stack: ExitStack) -> socket.socket:
        host, _, number = self.port.path.removeprefix("socket://").partition(":")
        client = stack.enter_context(socket.create_connection((host, int(number)), PATIENCE_S))
        self.turn()
        return client


@pytest.fixture(name="served")
def _served() -> Iterator[Served]:
    with TcpServerPort() as port:
        yield Served(port)


@pytest.fixture(name="stack")
def _stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def wire(*messages: Message) -> bytes:
    """Return the bytes that a host sends for these messages."""
    link = Link(Direction.HOST)
    for message in messages:
        link.send(message, 5_000_000, node=1)
    return link.data_to_send()


def rest(client: socket.socket) -> bytes:
    """Return all bytes until the peer closes the connection."""
    data = b""
    while more := client.recv(4096):
        data += more
    return data


def test_a_second_client_may_stop_the_robot_and_receives_the_answer(
    served: Served, stack: ExitStack
) -> None:
    host, other = served.connect(stack), served.connect(stack)
    host.sendall(wire(HELLO))
    served.until(HELLO)
    other.sendall(wire(STOP))
    served.until(STOP)
    assert served.port.write(b"the answer") == len(b"the answer")
    assert other.recv(100) == b"the answer"
    assert host.recv(100) == b"the answer"
    host.sendall(wire(TimeRequest(3)))
    served.until(TimeRequest(3))  # the first client is still the host


def test_only_a_stop_is_accepted_from_a_second_client(served: Served, stack: ExitStack) -> None:
    host, other = served.connect(stack), served.connect(stack)
    host.sendall(wire(HELLO))
    served.until(HELLO)
    other.sendall(wire(STOP, SetMode(8, Mode.VELOCITY), VelocitySetpoint(1000, 0, 200, 1)))
    served.until(STOP)
    host.sendall(wire(TimeRequest(3)))
    served.until(TimeRequest(3))
    assert served.received == [HELLO, STOP, TimeRequest(3)]
    assert rest(other).startswith(b"rejected: this sweeper has a host already, 127.0.0.1:")


def test_a_stop_needs_no_place_that_idle_clients_have_taken(
    served: Served, stack: ExitStack
) -> None:
    host = served.connect(stack)
    for _ in range(20):
        served.connect(stack)
    served.connect(stack).sendall(wire(STOP))
    served.until(STOP)
    host.sendall(wire(HELLO))
    served.until(HELLO)


def test_a_host_that_reads_nothing_does_not_hold_up_the_answer_to_a_stop(
    served: Served, stack: ExitStack
) -> None:
    served.connect(stack)
    other = served.connect(stack)
    while served.port.write(bytes(65_536)):
        pass  # until the host's socket is full
    other.sendall(wire(STOP))
    served.until(STOP)
    assert served.port.write(b"the answer") == len(b"the answer")
    assert other.recv(100) == b"the answer"


def test_a_stop_uses_the_remaining_room_of_the_line(served: Served, stack: ExitStack) -> None:
    host, other = served.connect(stack), served.connect(stack)
    host.sendall(bytes(20_000))  # the host's own bytes fill the link
    other.sendall(wire(STOP))
    while STOP not in served.received:
        served.turn(limit=3)
