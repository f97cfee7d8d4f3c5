"""A request for another node than that of the port's owner changes nothing there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import bridge
from support.cli import sweepctl
from support.served import Served

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def served() -> Iterator[Served]:
    with Served() as served:
        yield served


def test_parameters_and_reboots_are_for_the_node_of_the_owner(served: Served) -> None:
    with bridge.open(served.port) as robot:
        before = robot.get_parameter("max_speed").value
        for request in (
            ("param", "get", served.port, "max_speed"),
            ("param", "set", served.port, "max_speed", "0.21"),
            ("reboot", served.port),
        ):
            rejected = sweepctl(*request, "--node", "3")
            assert rejected.status == 3, request
            assert "connected to node 1; the request is for node 3" in rejected.err
        assert robot.get_parameter("max_speed").value == before
        own = sweepctl("param", "set", served.port, "max_speed", "0.21", "--node", "1")
        assert own.status == 0, own.err
        assert robot.get_parameter("max_speed").value != before


def test_a_stop_of_another_node_stops_the_owner_s_robot_and_is_not_confirmed(
    served: Served,
) -> None:
    with bridge.open(served.port):
        stopped = sweepctl("stop", served.port, "--node", "3")
    assert stopped.status == 3
    assert "node 3 has not confirmed the stop; its owner has stopped node 1" in stopped.err
