"""Each kind of fault by what it does to bytes, to readings, to the true robot; and its end."""

from __future__ import annotations

import math
import statistics

import pytest

from bridge.session_events import Agreed, State
from protocol.can_link import CanLink
from protocol.messages import Encoders, Imu, Power, Range
from protocol.values import Contact, ResetCause
from sim_device.device import VirtualSweeper
from sim_device.line import LineSettings
from support.rigs import Drive, rig
from support.sim_body import box, room

AHEAD = room((5.0, 5.0, 0.0), walls=box(4.0, 4.0, 8.0, 6.0), obstacles=(box(7.0, 4.5, 7.2, 5.5),))
"""An obstacle 2 m before the robot: 1.88 m before its ultrasonic sensor."""


def lost_frames(drive: Drive, since_s: float, until_s: float) -> float:
    """Share of the inertial samples, 100 a second, that did not come."""
    return 1.0 - len(drive.of(Imu, since_s, until_s)) / (100 * (until_s - since_s))


# ---- the line -----------------------------------------------------------------------------


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
    # A frame of about 30 bytes is whole with a chance of 0.99^30 = 74 % (or 0.995^30 = 86 %).
    assert 0.02 < lost_frames(drive, 2.0, 3.0) < 0.6
    drive.run(4.0)
    assert drive.session.link.statistics.damaged <= damaged + 1, "one that it had begun to spoil"
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
def test_nothing_intact_comes_while_it_lasts(fault: str) -> None:
    drive = Drive(rig(fault))
    drive.run(4.0)
    assert drive.of(Imu, 1.5, 2.0)
    assert not drive.of(Imu, 2.01, 2.5)
    assert drive.of(Imu, 2.6, 3.0), "shorter than what loses a session"
    assert drive.session.state is State.READY
    silent = not any(2.01e6 <= at_us < 2.5e6 for at_us, _ in drive.bytes)
    assert silent == (fault != "wrong-baud@2:0.5")


def test_an_unplugged_port_is_none() -> None:
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
    assert len(drive.agreed()) == 2
    assert abs(drive.rig.truth.v_m_s) < 0.001, "the stop is latched"


def test_frames_on_a_bus_come_later_lost_or_twice_but_never_changed() -> None:
    bus = LineSettings(0, 0, 500_000)
    drive = Drive(
        rig("bit-flips@2:2:rate=0.01", "byte-loss@5:2:rate=0.01", settings=bus, link=CanLink)
    )
    drive.run(4.5)
    assert drive.rig.counts().harmed > 30
    assert drive.session.link.statistics.damaged == 0
    assert lost_frames(drive, 2.0, 4.0) < 0.02, "sent again by its controller"
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
    first, second = (event.hello for event in drive.agreed())
    assert first.boot_id != second.boot_id
    assert second.reset_cause == found
    assert drive.rig.plant.tick_ms >= 5_990, "the body lives on"


def test_firmware_that_hangs_drives_on_until_its_watchdog_bites() -> None:
    drive = Drive(rig("hang@3"), 0.2)
    drive.run(3.09)
    assert drive.rig.truth.v_m_s > 0.15
    assert not [at for at, _ in drive.bytes if at >= 3.01e6]
    drive.velocity = (0.0, 0.0)  # whoever drove it looks first
    drive.run(3.6)
    assert abs(drive.rig.truth.v_m_s) < 0.001
    drive.run(8.0)
    assert drive.agreed()[-1].hello.reset_cause == ResetCause.WATCHDOG
    assert abs(drive.rig.truth.v_m_s) < 0.001


def test_a_brown_out_is_silent_for_its_time() -> None:
    drive = Drive(rig("brown-out@2:off=0.8"))
    drive.run(7.0)
    assert not [at for at, _ in drive.bytes if 2.01e6 <= at < 2.8e6]
    assert drive.agreed()[-1].hello.reset_cause == ResetCause.BROWN_OUT


def stamps(drive: Drive) -> list[tuple[int, int]]:
    """When a sample came, and its stamp."""
    return [(h.at_us, h.t_us) for h in drive.heard if isinstance(h.message, Imu)]


def test_a_clock_that_drifts() -> None:
    drive = Drive(rig("clock-drift@2:10:ppm=1000"))
    drive.run(15.0)
    ahead = {at // 1_000_000: t - at for at, t in stamps(drive)}
    # 1000 ppm for 10 s are 10 ms; a sample is up to one tick old.
    assert abs(ahead[12] - ahead[1] - 10_000) <= 200
    assert abs(ahead[14] - ahead[12]) <= 200, "no faster than any other afterwards"


def test_a_clock_that_jumps() -> None:
    drive = Drive(rig("clock-jump@2:ms=300"))
    drive.run(4.0)
    ahead = [(at, t - at) for at, t in stamps(drive)]
    before = [d for at, d in ahead if at < 1.9e6]
    after = [d for at, d in ahead if at > 2.1e6]
    assert abs(statistics.median(after) - statistics.median(before) - 300_000) < 1_000


# ---- sensors ------------------------------------------------------------------------------


def test_a_frozen_imu_repeats_itself() -> None:
    drive = Drive(rig("imu-frozen@3:1"), 0.0, 1.0)
    drive.run(5.0)
    frozen = {(m.gyro_z_rad_s, m.gyro_x, m.accel_x) for m in drive.of(Imu, 3.05, 4.0)}
    assert len(frozen) == 1
    assert len({m.gyro_z_rad_s for m in drive.of(Imu, 4.1, 5.0)}) > 1


def test_a_biased_imu_is_off_by_that_much() -> None:
    drive = Drive(rig("imu-biased@2:2:gyro=5,accel=0.1", "imu-biased@3:1:gyro=-2"))
    drive.run(6.0)

    def rate_deg_s(since_s: float) -> float:
        rates = [m.gyro_z_rad_s for m in drive.of(Imu, since_s + 0.2, since_s + 1.0)]
        return math.degrees(statistics.mean(rates))

    assert rate_deg_s(1.0) == pytest.approx(0.0, abs=0.05)
    assert rate_deg_s(2.0) == pytest.approx(5.0, abs=0.05)
    assert rate_deg_s(3.0) == pytest.approx(3.0, abs=0.05), "two together"
    assert rate_deg_s(4.5) == pytest.approx(0.0, abs=0.05)


def wheel_counts(drive: Drive, since_s: float, until_s: float) -> tuple[int, int]:
    samples = drive.of(Encoders, since_s, until_s)
    first, last = samples[0], samples[-1]
    return last.left - first.left, last.right - first.right


def test_an_encoder_that_misses_counts() -> None:
    drive = Drive(rig("encoder-dropout@3:5:left,share=0.5"), 0.2)
    drive.run(5.0)
    left, right = wheel_counts(drive, 3.5, 5.0)
    assert right > 500
    # The device drives the wheel by its encoder: the left wheel turns faster for it.
    turned_left = drive.rig.truth.left_rad_s
    assert turned_left > 1.5 * drive.rig.truth.right_rad_s
    assert left == pytest.approx(right, rel=0.2)


def test_a_blind_and_a_lying_ultrasonic() -> None:
    drive = Drive(rig("ultrasonic-blind@2:1", "ultrasonic-lies@4:1:m=0.7", plan=AHEAD))
    drive.run(6.0)

    def readings(since_s: float) -> set[float | None]:
        found = drive.of(Range, since_s + 0.2, since_s + 1.0)
        return {m.ultrasonic_m and round(m.ultrasonic_m, 2) for m in found}

    assert readings(1.0) == readings(5.0) == {1.88}
    assert readings(2.0) == {None}
    assert readings(4.0) == {0.70}


def test_a_bumper_that_stays_pressed() -> None:
    drive = Drive(rig("bumper-stuck@2:1:side=right"))
    drive.run(4.0)
    assert {m.contacts & Contact.BUMPER_RIGHT for m in drive.of(Range, 2.2, 3.0)} != {0}
    assert not any(m.contacts & Contact.BUMPER_LEFT for m in drive.of(Range))
    assert not any(m.contacts & Contact.BUMPER_RIGHT for m in drive.of(Range, 3.2, 4.0))


# ---- wheels, battery, people --------------------------------------------------------------


def test_a_stuck_wheel_does_not_turn() -> None:
    drive = Drive(rig("wheel-stuck@3:1:side=left"), 0.15)
    drive.run(3.1)
    before = drive.rig.truth
    drive.run(3.9)
    after = drive.rig.truth
    assert after.left_rad == before.left_rad
    assert after.right_rad > before.right_rad + 0.5
    assert after.heading_rad > before.heading_rad + 0.1
    drive.run(5.0)
    assert drive.rig.truth.left_rad > after.left_rad + 1.0


def test_a_slipping_wheel_takes_the_robot_less_far() -> None:
    drive = Drive(rig("wheel-slip@4:2:both,share=0.5"), 0.2)

    def gone_m(since_s: float, until_s: float) -> float:
        drive.run(since_s)
        before = drive.rig.truth.pose
        drive.run(until_s)
        return drive.rig.truth.pose.distance_m(before)

    free, slipping, again = gone_m(3.0, 4.0), gone_m(4.2, 5.2), gone_m(6.5, 7.5)
    assert free == pytest.approx(0.2, rel=0.03)
    assert slipping == pytest.approx(0.5 * free, rel=0.03)
    assert again == pytest.approx(free, rel=0.03)


def test_a_flat_battery_gives_less() -> None:
    drive = Drive(rig("battery-flat@2:charge=0.05"))
    drive.run(4.0)
    assert drive.rig.plant.state_of_charge == pytest.approx(0.05, abs=0.001)
    full = drive.of(Power, 1.0, 2.0)[-1].battery_v
    assert drive.of(Power, 3.0, 4.0)[-1].battery_v < full - 1.0


def test_a_lifted_robot_s_wheels_turn_in_the_air() -> None:
    drive = Drive(rig("lifted@3:1"), 0.2)
    drive.run(3.05)
    before = drive.rig.truth
    drive.run(3.3)
    assert drive.rig.truth.pose.distance_m(before.pose) < 0.002
    assert drive.rig.truth.left_rad > before.left_rad
    drive.run(4.0)
    assert any(m.contacts & Contact.CLIFF for m in drive.of(Range, 3.2, 4.0))


def nearest(drive: Drive, since_s: float, until_s: float) -> float:
    readings = [m.ultrasonic_m for m in drive.of(Range, since_s, until_s)]
    return min(r for r in readings if r is not None)


def test_an_obstacle_is_moved_and_moved_back() -> None:
    drive = Drive(rig("obstacle@2:2:dx=-0.5", "obstacle@3:1:index=0,dx=0.2", plan=AHEAD))
    drive.run(6.0)
    assert nearest(drive, 1.0, 1.9) == pytest.approx(1.88, abs=0.01)
    assert nearest(drive, 2.3, 2.9) == pytest.approx(1.38, abs=0.01)
    assert nearest(drive, 3.3, 3.9) == pytest.approx(1.58, abs=0.01), "moves add up"
    assert nearest(drive, 4.3, 5.9) == pytest.approx(1.88, abs=0.01)


def test_a_person_walks_by_and_goes() -> None:
    drive = Drive(rig("person@2:3:ahead=0.9,speed=0.8,reach=0.8", plan=AHEAD))
    drive.run(7.0)
    # The leg's skin is 0.84 m ahead of the centre as it crosses, 0.72 m of the sensor.
    assert nearest(drive, 2.0, 5.0) == pytest.approx(0.72, abs=0.03)
    far = [m.ultrasonic_m for m in drive.of(Range, 2.0, 5.0) if (m.ultrasonic_m or 0) > 1.5]
    assert len(far) > 10, "to and fro, not standing there"
    assert nearest(drive, 5.2, 7.0) == pytest.approx(1.88, abs=0.01)


def test_a_person_waits_rather_than_walk_into_the_robot() -> None:
    drive = Drive(rig("person@1:8:ahead=0.3,speed=0.8,reach=0.8"))
    drive.run(9.0)
    assert drive.rig.truth.collisions == 0
    assert drive.rig.truth.contact_s == 0.0
    assert drive.rig.truth.path_m < 0.001


# ---- together -----------------------------------------------------------------------------


def test_the_end_of_one_does_not_end_another() -> None:
    made = rig("wheel-stuck@1:3:left", "wheel-stuck@2:1:both", "wheel-slip@1:both,share=0.5")
    faults = made.plant.faults
    made.step(b"", 1_500_000)
    assert (faults.stuck_left, faults.stuck_right, faults.slip_left) == (True, False, 0.5)
    made.step(b"", 2_500_000)
    assert (faults.stuck_left, faults.stuck_right) == (True, True)
    made.faults.start("wheel-slip:left,share=0.5")
    made.step(b"", 3_500_000)
    assert (faults.stuck_left, faults.stuck_right) == (True, False)
    assert (faults.slip_left, faults.slip_right) == (0.75, 0.5)
    assert made.faults.clear("wheel-slip") == 2
    made.step(b"", 4_500_000)
    assert (faults.stuck_left, faults.slip_left, faults.slip_right) == (False, 0.0, 0.0)
    assert made.faults.active == []


def test_what_happened_is_told_with_its_time() -> None:
    made = rig("silence@1:0.5", "reset@2", "unplug@9")
    made.step(b"", 3_000_000)
    made.faults.start("lifted@+1:0.25")
    made.step(b"", 5_000_000)
    told = [(e.t_us, e.what, e.spec.kind.name) for e in made.faults.take_events()]
    assert told == [
        (1_000_000, "began", "silence"),
        (1_500_000, "ended", "silence"),
        (2_000_000, "struck", "reset"),
        (4_000_000, "began", "lifted"),
        (4_250_000, "ended", "lifted"),
    ]
    assert [spec.kind.name for spec in made.faults.waiting] == ["unplug"]
    assert made.faults.take_events() == []


# ---- seeds --------------------------------------------------------------------------------

STORM = (
    "bit-flips@1:rate=0.001",
    "byte-loss@1:rate=0.0005",
    "duplicates@1:rate=0.0005",
    "bursts@1.5:1:rate=0.0005",
    "jitter@1:ms=5",
    "person@1.5:1",
    "wheel-slip@2",
)


def storm(seed: int) -> list[tuple[int, bytes]]:
    drive = Drive(rig(*STORM, settings=LineSettings(), seed=seed), 0.1)
    drive.run(3.5)
    return drive.bytes


def test_the_same_seed_gives_the_same_bytes() -> None:
    first = storm(1)
    assert first == storm(1)
    assert first != storm(2)


def test_without_faults_a_straight_line_is_none() -> None:
    with_rig, bare = rig(seed=3), rig(seed=3).device
    drive = Drive(with_rig, 0.2)
    sent: list[tuple[int, bytes]] = []
    step = with_rig.step

    def taped(data: bytes, now_us: int) -> bytes:
        sent.append((now_us, data))
        return step(data, now_us)

    with_rig.step = taped  # type: ignore[method-assign]  # a tap on the wire
    drive.run(3.0)
    out = [(at_us, bare.step(data, at_us)) for at_us, data in sent]
    assert [(at, data) for at, data in out if data] == drive.bytes
    assert bare.truth == with_rig.truth


def test_a_fault_that_never_comes_changes_nothing() -> None:
    runs = []
    for faults in ((), ("bit-flips@100",), ("person@100", "reset@100")):
        drive = Drive(rig(*faults), 0.2)
        drive.run(2.5)
        runs.append(drive.bytes)
    assert runs[0] == runs[1] == runs[2]


def test_agreement_over_the_real_line_and_its_pace() -> None:
    drive = Drive(rig(settings=LineSettings(115_200, 16_000)))
    drive.run(4.0)
    assert isinstance(drive.agreed()[0], Agreed)
    assert drive.session.link.statistics.lost == 0
    assert lost_frames(drive, 2.0, 4.0) < 0.02
    for at_us, data in drive.bytes:
        assert len(data) <= 62 * (1 + 16_000 * 11_520 // 62_000_000) + 124
        assert at_us > 0
    assert 16_000 <= max(drive.round_trips_us(1.0, 4.0)) < 40_000


def test_what_the_host_does_not_take_fills_the_adapter_and_is_lost() -> None:
    drive = Drive(rig(settings=LineSettings()))
    drive.run(2.0)
    made, now_us, held = drive.rig, drive.now_us, 0
    while made.counts().adapter_overrun == 0:
        now_us = made.next_deadline_us()
        out = made.step(b"", now_us)
        made.give_back(out, now_us)
        held = max(held, len(out))
        assert now_us < 6_000_000
    assert held <= 4096 + 62
    out = made.step(b"", now_us + 1_000)
    assert 4000 < len(out) <= 4096 + 200, "what was kept comes when the host reads again"
