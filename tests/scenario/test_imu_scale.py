"""A device with another IMU scale than in the catalogue: SI values must be correct everywhere."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from bridge.motion.geometry import wrap_angle
from bridge.session.records import DeviceMessage
from protocol.imu import NOMINAL, ImuReader, ImuScale
from protocol.messages.device import Imu, ImuInfo
from protocol.schema.catalogue import CATALOGUE
from sim_device.sensors.imu import ImuConfig
from sim_device.sweeper import VirtualSweeper
from support.ends import OPEN_FLOOR, Collector, Ends, HostEnd, spinning_host
from support.read_log import written

if TYPE_CHECKING:
    from pathlib import Path

OTHER = ImuConfig(gyro_range_deg_s=500, accel_range_g=4)
G_M_S2 = 9.80665


def test_the_nominal_scale_is_that_of_the_catalogue() -> None:
    assert NOMINAL.info() == ImuInfo(163_840_000, 1_310_000, 3_400_000, 3653)
    assert ImuScale.of(NOMINAL.info()) == NOMINAL
    assert ImuConfig().scale == NOMINAL


def test_a_sample_has_the_same_si_value_with_any_scale() -> None:
    scale = ImuScale.of(ImuInfo(81_920_000, 655_000, 1_000_000, -1000))
    assert scale is not None
    reader = ImuReader()
    sample = Imu(8192, -8192, 4096, 3500, 655, -131, 0)
    assert reader.take(sample) is None, "not before the scale is known"
    reader.take(scale.info())
    read = reader.take(sample)
    assert isinstance(read, Imu)
    assert (read.accel_x_m_s2, read.accel_z_m_s2) == pytest.approx((G_M_S2, G_M_S2 / 2))
    assert (read.gyro_x_rad_s, read.gyro_y_rad_s) == pytest.approx(
        (math.radians(10), math.radians(-2))
    )
    assert read.temperature_deg_c == pytest.approx(3500 / 100 - 10)
    declared = scale.declared(CATALOGUE.spec(Imu))
    assert declared.fields[0].si_gain * 8192 == pytest.approx(G_M_S2)


def test_counts_of_no_worth_change_no_scale() -> None:
    reader = ImuReader(NOMINAL)
    for worthless in (ImuInfo(0, 1, 1, 0), ImuInfo(1, 0, 1, 0), ImuInfo(1, 1, 0, 0)):
        reader.take(worthless)
    assert reader.scale == NOMINAL


def spun(config: ImuConfig) -> tuple[Ends, Collector]:
    """Return host and device after some turns in place."""
    sink = Collector()
    device = VirtualSweeper(OPEN_FLOOR, seed=1, noise="none", imu=config)
    ends = Ends(HostEnd(spinning_host(sink)), device)
    ends.run(12.0)
    return ends, sink


def imu_of(sink: Collector) -> list[Imu]:
    return [r.message for r in sink.of(DeviceMessage) if isinstance(r.message, Imu)]


def test_a_run_with_another_scale_is_as_good(tmp_path: Path) -> None:
    ends, sink = spun(OTHER)
    usual, usual_sink = spun(ImuConfig())
    errors = [
        wrap_angle(e.host.host.estimator.pose.theta_rad - e.device.plant.pose.theta_rad)
        for e in (ends, usual)
        if isinstance(e.host, HostEnd)
    ]
    assert errors[0] == pytest.approx(errors[1], abs=0.01), "beside the delay of the last samples"
    assert abs(errors[0]) < 0.1
    fastest, usual_fastest = (max(abs(m.gyro_z) for m in imu_of(s)) for s in (sink, usual_sink))
    assert fastest == pytest.approx(usual_fastest / 2, rel=0.05), "counts stay the device's own"
    assert min(m.accel_z for m in imu_of(sink)) == pytest.approx(8192, abs=200)

    log = written(tmp_path / "run.mcap", *sink.records)
    samples = [d for topic, _, d in log if topic == "/device/imu"]
    assert all(d.gyro_z_rad_s == pytest.approx(math.radians(d.gyro_z / 65.5)) for d in samples)
    assert all(d.accel_z_m_s2 == pytest.approx(d.accel_z / 8192 * G_M_S2) for d in samples)
    ros = [d for topic, _, d in log if topic == "/ros/imu"]
    assert len(ros) == len(samples) > 100
    for sample, message in zip(samples, ros, strict=True):
        assert message.angular_velocity.z == pytest.approx(sample.gyro_z_rad_s)
    (info, *_) = [d for topic, _, d in log if topic == "/device/imu_info"]
    assert info.gyro_per_deg_s == pytest.approx(65.5)


def test_a_log_gives_no_si_values_before_the_scale(tmp_path: Path) -> None:
    """After the device has sent its scale, the log has SI values by the newest scale."""
    other = OTHER.scale.info()
    sample = Imu(100, 0, 8192, 0, 0, 0, 655)
    messages = [sample, other, sample, NOMINAL.info(), sample]
    records = [
        DeviceMessage(10**9 * (i + 1), None, None, 1, i, i, CATALOGUE.spec(type(m)).name, m)
        for i, m in enumerate(messages)
    ]
    log = written(tmp_path / "run.mcap", *records)
    before, wide, usual = (d for topic, _, d in log if topic == "/device/imu")
    assert (before.gyro_z, before.HasField("gyro_z_rad_s")) == (655, False)
    assert wide.gyro_z_rad_s == pytest.approx(math.radians(10))
    assert usual.gyro_z_rad_s == pytest.approx(math.radians(5))
    assert sum(topic == "/ros/imu" for topic, _, _ in log) == 2
