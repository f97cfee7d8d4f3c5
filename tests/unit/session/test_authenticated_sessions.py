"""Sessions in which host and device have a key or none, and the setting of a key."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.run.mission import Phase
from bridge.session.session import Session
from bridge.session.states import CommandEnded, State
from protocol.authentication import (
    key_words,
)
from protocol.can.link import CanLink
from protocol.messages.host import ClearStop, GetParameter, HostHello, SetKey, Stop, StopAll
from protocol.messages.values import Mode, NackReason, StopCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction, Message
from protocol.uart.link import Link
from support.ends import Ends, HostEnd, SessionEnd, check_safe, spinning_host, sweeper

if TYPE_CHECKING:
    from protocol.link import LinkBase, LinkEvent
    from protocol.schema.codec import Codec
    from sim_device.sweeper import VirtualSweeper

pytestmark = pytest.mark.slow

KEY = bytes(range(1, 17))
OTHER = bytes(16)[:-1] + b"\x01"

_ids = iter(range(0xA000_0001, 0xA100_0000))


def device(key: bytes | None, link: type[LinkBase] = Link) -> VirtualSweeper:
    made = sweeper(link=link)
    made.flash.key = key
    made.firmware.keyring.take()
    return made


def host(key: bytes | None, link: type[LinkBase] = Link) -> SessionEnd:
    return SessionEnd(Session(lambda: next(_ids), link=link, key=key))


def both(
    own: bytes | None, theirs: bytes | None, link: type[LinkBase] = Link
) -> tuple[Ends, SessionEnd]:
    end = host(own, link)
    ends = Ends(end, device(theirs, link))
    ends.watch = lambda: check_safe(ends)
    assert ends.run(4.0, lambda: end.session.state is State.READY)
    return ends, end


def held(ends: Ends) -> str:
    return ends.device.firmware.latch.cause.name.lower()


def flash_key(ends: Ends) -> bytes | None:
    return ends.device.flash.key


def outcomes(end: SessionEnd) -> list[tuple[bool, int | None]]:
    return [(e.outcome.accepted, e.outcome.reason) for e in end.of(CommandEnded)]


@pytest.mark.parametrize("link", [Link, CanLink])
def test_with_the_key_everything_works(link: type[LinkBase]) -> None:
    ends, end = both(KEY, KEY, link)
    end.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    end.session.set_mode(Mode.VELOCITY, ends.host_ns)
    ends.run(0.2)
    assert outcomes(end) == [(True, None), (True, None)]
    end.each_turn = lambda now_ns: end.session.setpoint(0.1, 0.0, 200, now_ns)
    assert ends.run(1.0, lambda: ends.moving)
    ends.run(3.0)
    assert ends.moving


@pytest.mark.parametrize("link", [Link, CanLink])
def test_a_command_without_a_tag_is_rejected_before_anything_else_comes(
    link: type[LinkBase],
) -> None:
    """On CAN, the device waits at most 10 ms for the tag, even if no other frame follows."""
    ends, end = both(None, KEY, link)
    for _ in range(5):
        before = len(outcomes(end))
        end.session.command(GetParameter, (0,), ends.host_ns)
        ends.run(0.035)  # 10 ms, plus up to two control periods
        assert outcomes(end)[before:] == [(False, NackReason.NOT_AUTHENTICATED)]


@pytest.mark.parametrize("link", [Link, CanLink])
@pytest.mark.parametrize("own", [None, OTHER], ids=["no key", "another key"])
def test_without_the_key_only_a_stop_is_obeyed(own: bytes | None, link: type[LinkBase]) -> None:
    ends, end = both(own, KEY, link)
    end.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    end.session.command(GetParameter, (0,), ends.host_ns)
    ends.run(3.0)
    assert not any(accepted for accepted, _ in outcomes(end))
    if own is None:
        assert {reason for _, reason in outcomes(end)} == {NackReason.NOT_AUTHENTICATED}
    assert held(ends) == "session_end"
    end.session.stop(StopCause.OPERATOR, ends.host_ns)
    ends.run(0.2)
    assert held(ends) == "operator"


def test_a_key_that_the_device_does_not_ask_for_is_not_used() -> None:
    ends, end = both(KEY, None)
    end.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    ends.run(0.2)
    assert outcomes(end) == [(True, None)]
    assert end.session.link.key is not None
    assert not end.session.link.key.begun


def test_a_restarted_host_and_a_rebooted_device_restart_signing() -> None:
    ends, _ = both(KEY, KEY)
    second = host(KEY)
    ends.restart_host(second)
    assert ends.run(4.0, lambda: second.session.state is State.READY)
    ends.reboot_device(991)
    assert ends.run(4.0, lambda: second.session.state is not State.READY)
    assert ends.run(4.0, lambda: second.session.state is State.READY)
    second.session.set_mode(Mode.BRINGUP, ends.host_ns)
    second.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    ends.run(0.3)
    assert outcomes(second)[-2:] == [(False, NackReason.STOP_LATCHED), (True, None)]


@pytest.mark.parametrize("boot_id", [None, 992], ids=["same boot", "fresh boot"])
def test_recorded_motion_of_one_session_moves_nothing_in_another(boot_id: int | None) -> None:
    """An attacker records the host's frames, and replays them after the host has gone."""
    ends, end = both(KEY, KEY)
    taped: list[bytes] = []
    turn = end.turn

    def tapped(data: list[bytes], now_ns: int) -> bytes:
        out = turn(data, now_ns)  # type: ignore[arg-type]  # host time
        if out:
            taped.append(out)
        return out

    end.turn = tapped  # type: ignore[assignment,method-assign]  # records what the host sends
    end.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    end.session.set_mode(Mode.VELOCITY, ends.host_ns)
    ends.run(0.2)
    end.each_turn = lambda now_ns: end.session.setpoint(0.1, 0.0, 200, now_ns)
    assert ends.run(1.0, lambda: ends.moving)
    ends.run(0.5)
    ends.host_alive = False
    ends.run(3.0)
    if boot_id is not None:
        ends.reboot_device(boot_id)
        ends.run(1.5)
    stood_us = ends.moving_us
    boot = ends.device.firmware.identity.boot_id
    hello = HostHello(
        CATALOGUE.hash, end.session.session_id, boot, 1, "thief"
    )  # hellos are not signed
    thief = Link(Direction.HOST)
    for _ in range(3):
        thief.send(hello, ends.host_ns // 1000, node=1)
        ends.to_device.push(thief.data_to_send(), ends.now_us)
        ends.run(0.05)
        for data in taped:
            ends.to_device.push(data, ends.now_us)
            ends.run(0.002)
    ends.run(1.0)
    assert ends.moving_us == stood_us
    assert ends.device.firmware.mode is Mode.IDLE


# ---- setting the key --------------------------------------------------------------------


def set_key(ends: Ends, end: SessionEnd, key: bytes | None) -> tuple[bool, int | None]:
    end.session.command(SetKey, key_words(key or bytes(16)), ends.host_ns)
    ends.run(0.3)
    outcome = outcomes(end)[-1]
    if outcome[0]:
        end.session.set_key(key, ends.host_ns)
        ends.run(0.2)
    return outcome


def test_a_key_is_set_used_replaced_and_removed() -> None:
    ends, end = both(None, None)
    assert set_key(ends, end, KEY) == (True, None)
    end.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    ends.run(0.2)
    assert outcomes(end)[-1] == (True, None)
    assert set_key(ends, end, OTHER) == (True, None)
    assert flash_key(ends) == OTHER
    assert set_key(ends, end, None) == (True, None)
    assert flash_key(ends) is None
    end.session.set_mode(Mode.VELOCITY, ends.host_ns)
    ends.run(0.2)
    assert outcomes(end)[-1] == (True, None)


def test_a_key_outlives_a_reboot() -> None:
    ends, end = both(None, None)
    set_key(ends, end, KEY)
    ends.reboot_device(55)
    assert ends.run(4.0, lambda: end.session.state is not State.READY)
    assert ends.run(4.0, lambda: end.session.state is State.READY)
    stranger = host(None)
    ends.restart_host(stranger)
    assert ends.run(4.0, lambda: stranger.session.state is State.READY)
    assert set_key(ends, stranger, OTHER) == (False, NackReason.NOT_AUTHENTICATED)


def test_no_key_is_set_over_a_bus_or_a_network_or_while_it_may_move() -> None:
    ends, end = both(None, None, CanLink)
    assert set_key(ends, end, KEY) == (False, NackReason.UNSUPPORTED)
    ends, end = both(None, None)
    ends.device.firmware.keyring.may_set = False
    assert set_key(ends, end, KEY) == (False, NackReason.UNSUPPORTED)
    ends, end = both(None, None)
    end.session.clear_stop(StopCause.SESSION_END, ends.host_ns)
    end.session.set_mode(Mode.VELOCITY, ends.host_ns)
    ends.run(0.2)
    assert set_key(ends, end, KEY) == (False, NackReason.OTHER_MODE)
    assert flash_key(ends) is None


class Tapped(Link):
    """A link that keeps the received bytes."""

    def __init__(self, sends: Direction, *, codec: Codec | None = None) -> None:
        super().__init__(sends, codec=codec)
        self.received = b""

    def receive(self, data: bytes, now_us: int = 0) -> list[LinkEvent]:
        self.received += data
        return super().receive(data, now_us)


def test_the_key_is_on_the_link_once_and_never_printed() -> None:
    end = host(None, Tapped)
    ends = Ends(end, device(None))
    assert ends.run(4.0, lambda: end.session.state is State.READY)
    link = end.session.link
    assert isinstance(link, Tapped)
    set_key(ends, end, KEY)
    for number in range(13):
        end.session.command(GetParameter, (number,), ends.host_ns)
        ends.run(0.1)
    ends.run(1.0)
    assert len(link.received) > 1000
    assert KEY not in link.received
    assert KEY[4:8] not in link.received


def test_a_run_reports_missing_values() -> None:
    runner = spinning_host()
    ends = Ends(HostEnd(runner), device(KEY))
    assert ends.run(5.0, lambda: runner.mission.phase is Phase.DONE)
    assert runner.mission.ending is not None
    assert runner.mission.ending.exit_status == 4
    assert "not_authenticated" in runner.mission.ending.reason


@pytest.mark.parametrize(("stop", "node"), [(StopAll(), 0), (Stop(9, StopCause.OPERATOR), 1)])
def test_a_stop_needs_no_key_even_without_a_session(stop: Message, node: int) -> None:
    made = device(KEY)
    made.step(b"", 500_000)
    link = Link(Direction.HOST)
    link.send(stop, 1, node=node)
    link.send(ClearStop(10, StopCause.OPERATOR), 2, node=1)
    made.step(link.data_to_send(), 510_000)
    assert made.firmware.latch.cause is StopCause.OPERATOR
