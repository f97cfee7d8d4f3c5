"""Effect of faults of the link, the processor and its clock on bytes and time stamps."""

from __future__ import annotations

import statistics

import pytest

from bridge.session.states import State
from protocol.can.link import CanLink
from protocol.messages.device import Imu
from protocol.messages.values import ResetCause
from sim_device.line.line import LineSettings
from sim_device.sweeper import VirtualSweeper
from support.rigs import Drive, lost_frames, rig

# ---- the link -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "fault",
    [
        "bit-flips@2:1:rate=0.01",
        "byte-loss@2:1:rate=0.01",
        "bursts@2:1:rate=0.005,length=20",
        "duplicates@2:1:rate=0.005,length=10",
    ],
)
def test_damage_costs_frames_while_it_lasts_and_no_others(fault: str) -> None:
    drive = Drive(rig(fault))
    drive.run(2.0)
    assert drive.session.link.statistics.damaged == 0
    drive.run(3.0)
    damaged = drive.session.link.statistics.damaged
    assert damaged > 5
    # A frame of about 30 bytes arrives intact with a probability of 0.99^30 = 74 % (or 0.995^30 =
    # 86 %).
    assert 0.02 < lost_frames(drive, 2.0, 3.0) < 0.6
    drive.run(4.0)
    assert drive.session.link.statistics.damaged <= damaged + 1, (
        "one frame may be hit as the fault ends"
    )
    assert lost_frames(drive, 3.1, 4.0) < 0.01
    assert drive.rig.counts().harmed > 5
    assert drive.session.state is State.READY


def test_one_way_only() -> None:
    drive = Drive(rig("bit-flips@2:2:rate=0.02,way=down"))
    drive.run(4.0)
    assert drive.session.link.statistics.damaged == 0
    assert lost_frames(drive, 2.0, 4.0) < 0.01
    assert isinstance(drive.rig.device, VirtualSweeper)
    assert drive.rig.device.firmware.link.statistics.damaged > 0


def test_latency_and_jitter_in_the_round_trip() -> None:
    drive = Drive(rig("latency@3:2:ms=30", "jitter@6:2:ms=20,way=up"))
    drive.run(9.0)
    assert max(drive.round_trips_us(1.0, 3.0)) < 1_000
    late = drive.round_trips_us(3.1, 5.0)
    assert late
    assert all(60_000 <= trip < 61_000 for trip in late)
    shaken = drive.round_trips_us(6.1, 8.0)
    assert 0 <= min(shaken) < max(shaken) <= 21_000
    assert statistics.pstdev(shaken) > 2_000
    assert max(drive.round_trips_us(8.3, 9.0)) < 1_000
    assert drive.session.link.statistics.damaged == 0


@pytest.mark.parametrize("fault", ["silence@2:0.5", "wrong-baud@2:0.5", "unplug@2:0.5"])
def test_no_frame_is_intact_during_the_fault(fault: str) -> None:
    drive = Drive(rig(fault))
    drive.run(4.0)
    assert drive.of(Imu, 1.5, 2.0)
    assert not drive.of(Imu, 2.01, 2.5)
    assert drive.of(Imu, 2.6, 3.0), "the fault is too short to lose the session"
    assert drive.session.state is State.READY
    silent = not any(2.01e6 <= at_us < 2.5e6 for at_us, _ in drive.bytes)
    assert silent == (fault != "wrong-baud@2:0.5")


def test_an_unplugged_port_does_not_exist() -> None:
    made = rig("unplug@2:1")
    drive = Drive(made)
    plugged: list[bool] = []
    for until_s in (1.9, 2.5, 3.5):
        drive.run(until_s)
        plugged.append(made.plugged)
    assert plugged == [True, False, True]
    assert made.counts().unplugged > 1_000


def test_a_longer_silence_loses_the_session_and_it_comes_back_by_itself() -> None:
    drive = Drive(rig("silence@2:2"), 0.2)
    drive.run(2.0)
    assert drive.rig.truth.v_m_s > 0.15
    drive.run(3.9)
    states = [drive.session.state]
    assert abs(drive.rig.truth.v_m_s) < 0.001
    drive.run(8.0)
    states.append(drive.session.state)
    assert states == [State.LOST, State.READY]
    assert len(drive.negotiated()) == 2
    assert abs(drive.rig.truth.v_m_s) < 0.001, "the stop is latched"


def test_frames_on_a_bus_come_later_lost_or_twice_but_never_changed() -> None:
    bus = LineSettings(0, 0, 500_000)
    drive = Drive(
        rig("bit-flips@2:2:rate=0.01", "byte-loss@5:2:rate=0.01", settings=bus, link=CanLink)
    )
    drive.run(4.5)
    assert drive.rig.counts().harmed > 30
    assert drive.session.link.statistics.damaged == 0
    assert lost_frames(drive, 2.0, 4.0) < 0.02, "the CAN controller sends destroyed frames again"
    drive.run(7.0)
    assert lost_frames(drive, 5.0, 7.0) > 0.1
    assert drive.session.link.statistics.damaged == 0


# ---- the processor and its clock ----------------------------------------------------------


@pytest.mark.parametrize(
    ("cause", "found"), [("pin", ResetCause.PIN), ("watchdog", ResetCause.WATCHDOG)]
)
def test_a_reset(cause: str, found: ResetCause) -> None:
    drive = Drive(rig(f"reset@2:cause={cause}"))
    drive.run(6.0)
    first, second = (event.hello for event in drive.negotiated())
    assert first.boot_id != second.boot_id
    assert second.reset_cause == found
    assert drive.rig.plant.tick_ms >= 5_990, "the plant does not restart"


def test_firmware_that_hangs_drives_on_until_its_watchdog_bites() -> None:
    drive = Drive(rig("hang@3"), 0.2)
    drive.run(3.09)
    assert drive.rig.truth.v_m_s > 0.15
    assert not [at for at, _ in drive.bytes if at >= 3.01e6]
    drive.velocity = (0.0, 0.0)  # no setpoints after the reset
    drive.run(3.6)
    assert abs(drive.rig.truth.v_m_s) < 0.001
    drive.run(8.0)
    assert drive.negotiated()[-1].hello.reset_cause == ResetCause.WATCHDOG
    assert abs(drive.rig.truth.v_m_s) < 0.001


def test_a_brown_out_is_silent_for_its_time() -> None:
    drive = Drive(rig("brown-out@2:off=0.8"))
    drive.run(7.0)
    assert not [at for at, _ in drive.bytes if 2.01e6 <= at < 2.8e6]
    assert drive.negotiated()[-1].hello.reset_cause == ResetCause.BROWN_OUT


def stamps(drive: Drive) -> list[tuple[int, int]]:
    """Return the arrival time and the time stamp of each IMU sample, µs."""
    return [(h.at_us, h.t_us) for h in drive.received if isinstance(h.message, Imu)]


def test_a_clock_that_drifts() -> None:
    drive = Drive(rig("clock-drift@2:10:ppm=1000"))
    drive.run(15.0)
    ahead = {at // 1_000_000: t - at for at, t in stamps(drive)}
    # 1000 ppm for 10 s is 10 ms. A sample is up to one tick old.
    assert abs(ahead[12] - ahead[1] - 10_000) <= 200
    assert abs(ahead[14] - ahead[12]) <= 200, "the drift ends with the fault"


def test_a_clock_that_jumps() -> None:
    drive = Drive(rig("clock-jump@2:ms=300"))
    drive.run(4.0)
    ahead = [(at, t - at) for at, t in stamps(drive)]
    before = [d for at, d in ahead if at < 1.9e6]
    after = [d for at, d in ahead if at > 2.1e6]
    assert abs(statistics.median(after) - statistics.median(before) - 300_000) < 1_000
