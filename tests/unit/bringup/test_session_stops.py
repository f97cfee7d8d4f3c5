"""A bring-up session stops the robot at its end, and reports the stop after its confirmation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.bringup.port import InterruptedByPersonError
from bridge.errors import DeviceLostError, StoppedForSafetyError
from protocol.messages.values import LogLevel, Mode, StopCause
from support.bench_wire import RigWire, bringup_session
from support.ends import sweeper

if TYPE_CHECKING:
    from bridge.bringup.session import BringupSession
    from protocol.clock import HostNs


@pytest.fixture(name="moving")
def _moving() -> tuple[BringupSession, RigWire]:
    session, wire = bringup_session(sweeper())
    session.enable(Mode.VELOCITY)
    session.steer(lambda: (0.1, 0.0))
    session.run(1.0)
    assert latched(wire) is StopCause.NONE
    return session, wire


def latched(wire: RigWire) -> StopCause:
    return wire.device.firmware.latch.cause


def test_a_defect_in_the_session_does_not_keep_the_stop_from_the_device(
    moving: tuple[BringupSession, RigWire], monkeypatch: pytest.MonkeyPatch
) -> None:
    session, wire = moving

    def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(session.session, "data_to_send", broken)
    with pytest.raises(ZeroDivisionError), session:
        session.run(1.0)
    assert latched(wire) is StopCause.SESSION_END
    assert wire.closed


def test_a_stop_that_is_not_confirmed_is_an_error(
    moving: tuple[BringupSession, RigWire], monkeypatch: pytest.MonkeyPatch
) -> None:
    session, wire = moving
    turn = wire.turn

    def transmit_only(_data: bytes, until_ns: HostNs) -> bytes:
        return turn(b"", until_ns)

    monkeypatch.setattr(wire, "turn", transmit_only)
    before_s = session.now_s
    with pytest.raises(DeviceLostError, match="did not confirm the stop"):
        session.stop()
    assert session.now_s - before_s < 3.0
    with (
        pytest.raises(DeviceLostError, match=r"ended by Ctrl-C.*did not confirm") as raised,
        session,
    ):
        raise InterruptedByPersonError("ended by Ctrl-C")
    assert raised.value.exit_status == 3
    assert wire.closed


@pytest.mark.parametrize("error", ["", "stopped by itself: motor stalled"])
def test_a_latch_is_explained_by_the_devices_errors_only(
    moving: tuple[BringupSession, RigWire], error: str
) -> None:
    session, wire = moving
    firmware = wire.device.firmware
    if error:
        firmware.log(LogLevel.ERROR, error)
    firmware.log(LogLevel.INFO, "parameters saved")
    session.run(0.5)
    firmware.control.stop(StopCause.HARDWARE)
    with pytest.raises(StoppedForSafetyError) as raised:
        session.run(1.0)
    why = f": {error}" if error else ""
    assert str(raised.value) == f"the device latched a stop (cause: hardware){why}"
