"""The MPU6050 model against its datasheet and closed forms, for motions given by formulas."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from sim_device.noise import NOISE_LEVELS, NoiseLevel
from sim_device.sensors.faults import SensorFaults
from sim_device.sensors.imu import ImuConfig, ImuConfigError, ImuCounts, ImuSensor
from support.scripted_body import Scripted

NONE = NOISE_LEVELS["none"]
FAST = ImuConfig()


def chip(
    body: Scripted,
    level: NoiseLevel = NONE,
    *,
    seed: int = 1,
    faults: SensorFaults | None = None,
    config: ImuConfig = FAST,
) -> ImuSensor:
    return ImuSensor(body.plant, level, np.random.default_rng(seed), faults, config)


def read(body: Scripted, device: ImuSensor, count: int, *, every_ms: int = 10) -> list[ImuCounts]:
    out = []
    for _ in range(count):
        body.tick_ms += every_ms
        out.append(device.read())
    return out


def turning(rate_deg_s: float) -> Scripted:
    return Scripted(heading_deg=lambda t: rate_deg_s * t)


# Ranges and saturation.


@pytest.mark.parametrize(
    ("full_scale", "lsb"), [(250, 131.0), (500, 65.5), (1000, 32.8), (2000, 16.4)]
)
def test_gyro_ranges_have_the_datasheets_counts(full_scale: int, lsb: float) -> None:
    body = turning(100.0)
    device = chip(body, config=ImuConfig(gyro_range_deg_s=full_scale))
    assert read(body, device, 1)[0].gyro_z == round(100.0 * lsb)
    # A register saturates at 32 767 counts, which is about the full scale.
    assert 32767.0 / lsb == pytest.approx(full_scale, rel=2e-3)
    for rate, counts in ((1.1 * full_scale, 32767), (-1.1 * full_scale, -32768)):
        fast = turning(rate)
        quick = chip(fast, config=ImuConfig(gyro_range_deg_s=full_scale))
        assert read(fast, quick, 1)[0].gyro_z == counts


@pytest.mark.parametrize(("full_scale", "lsb"), [(2, 16384), (4, 8192), (8, 4096), (16, 2048)])
def test_accelerometer_ranges_have_the_datasheets_counts(full_scale: int, lsb: int) -> None:
    body = Scripted(impulse_x_m_s=lambda t: 0.5 * 9.80665 * t)
    device = chip(body, config=ImuConfig(accel_range_g=full_scale))
    reported = read(body, device, 1)[0]
    assert (reported.accel_x, reported.accel_y, reported.accel_z) == (lsb // 2, 0, lsb)
    hard = Scripted(impulse_x_m_s=lambda t: -20.0 * 9.80665 * t)
    device = chip(hard, config=ImuConfig(accel_range_g=full_scale))
    assert read(hard, device, 1)[0].accel_x == -32768


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"gyro_range_deg_s": 300}, "gyro range 300 is not one of 250, 500, 1000, 2000"),
        ({"accel_range_g": 3}, "accelerometer range 3 is not one of 2, 4, 8, 16"),
        ({"dlpf": 7}, "DLPF_CFG 7 is not one of 0 to 6"),
        ({"divider": 256}, "SMPLRT_DIV 256 is not one of 0 to 255"),
    ],
)
def test_a_setting_that_the_chip_has_not_is_named(settings: dict[str, int], text: str) -> None:
    with pytest.raises(ImuConfigError, match=text):
        ImuConfig(**settings)


def test_tilting_and_climbing_have_right_handed_signs() -> None:
    """A raised nose is a negative rotation about y; a raised left side is positive about x."""
    body = Scripted(
        pitch_rad=lambda t: math.radians(10.0 * t),
        roll_rad=lambda t: math.radians(20.0 * t),
        climb_m_s=lambda t: 0.1 * 9.80665 * t,
    )
    reported = read(body, chip(body), 1)[0]
    assert reported[4:] == (2620, -1310, 0)
    assert reported.accel_z == round(1.1 * 16384.0)


# Output rate and filter.


@pytest.mark.parametrize(
    ("config", "period_ms"),
    [
        (ImuConfig(), 10.0),
        (ImuConfig(divider=0), 1.0),
        (ImuConfig(divider=19), 20.0),
        (ImuConfig(dlpf=0, divider=79), 10.0),
    ],
)
def test_registers_change_at_the_output_rate(config: ImuConfig, period_ms: float) -> None:
    assert config.sample_period_ms == period_ms
    level = replace(NONE, gyro_density_deg_s_sqrt_hz=1.0)
    body = Scripted()
    device = chip(body, level, config=config)
    reported = [device.read(), *read(body, device, 100, every_ms=1)]
    changes = [ms for ms in range(1, 101) if reported[ms] != reported[ms - 1]]
    assert changes == [ms for ms in range(1, 101) if ms % period_ms == 0]


@pytest.mark.parametrize(("dlpf", "delay_ms"), [(3, 4.8), (4, 8.3), (5, 13.4), (6, 18.6)])
def test_the_filter_has_the_register_maps_group_delay(dlpf: int, delay_ms: float) -> None:
    """If the rate rises linearly, a filter outputs the earlier rate, by its group delay."""
    growth = 100.0  # °/s per s
    body = Scripted(heading_deg=lambda t: 0.5 * growth * t * t)
    device = chip(body, config=ImuConfig(dlpf=dlpf))
    reported = read(body, device, 100)[-1].gyro_z / 131.0
    assert 1000.0 * (1.0 - reported / growth) == pytest.approx(delay_ms, abs=0.25)


def test_a_narrow_filter_lets_less_noise_through() -> None:
    """White noise of density n, averaged over T, has σ = n/√(2T)."""
    level = replace(NONE, gyro_density_deg_s_sqrt_hz=0.5)
    for dlpf, window_s in ((3, 0.0096), (6, 0.0372)):
        body = Scripted()
        reported = read(body, chip(body, level, config=ImuConfig(dlpf=dlpf)), 6000)
        spread = np.std([t.gyro_x / 131.0 for t in reported])
        assert spread == pytest.approx(0.5 / math.sqrt(2.0 * window_s), rel=0.06)


# Noise.


def test_gyro_noise_falls_with_the_root_of_time_as_white_noise_does() -> None:
    """The Allan deviation at 0.1 s and 1 s is n/√(2τ). Aliasing in the chip's filter adds 2 %."""
    body = Scripted()
    n = 0.05
    reported = read(body, chip(body, replace(NONE, gyro_density_deg_s_sqrt_hz=n)), 20_000)
    rates = np.array([t.gyro_z for t in reported]) / 131.0
    for length in (10, 100):
        means = rates.reshape(-1, length).mean(axis=1)
        allan = math.sqrt(0.5 * float(np.mean(np.diff(means) ** 2)))
        expected = n / math.sqrt(2.0 * 0.01 * length) * math.sqrt(10.0 / 9.6)
        # With 200 means, the relative standard error of the deviation is about 6 %.
        assert allan == pytest.approx(expected, rel=0.2)


def test_accelerometer_noise_has_its_density_and_vibration_comes_with_motion() -> None:
    level = replace(NONE, accel_density_ug_sqrt_hz=400.0, accel_vibration_mg=15.0)
    body = Scripted(wheels_rad=lambda t: max(0.0, 6.0 * (t - 20.0)))
    reported = read(body, chip(body, level), 4000)
    rest, driving = reported[:1990], reported[2010:]
    rest_g = 400e-6 / math.sqrt(2.0 * 0.0096)
    assert np.std([t.accel_y / 16384.0 for t in rest]) == pytest.approx(rest_g, rel=0.07)
    assert np.std([t.accel_y / 16384.0 for t in driving]) == pytest.approx(
        math.hypot(rest_g, 0.015), rel=0.07
    )


def test_the_bias_walks_with_the_root_of_time() -> None:
    level = replace(NONE, gyro_bias_walk_deg_s_sqrt_s=1.0)
    ends = []
    for seed in range(60):
        body = Scripted()
        reported = read(body, chip(body, level, seed=seed), 400)
        ends.append(reported[-1].gyro_z / 131.0)
    # After 4 s, σ = 1 · √4. From 60 seeds its relative standard error is 9 %.
    assert np.std(ends) == pytest.approx(2.0, rel=0.3)


# Temperature.


def test_the_board_warms_up_and_the_register_shows_it() -> None:
    body = Scripted()
    device = chip(body)
    body.tick_ms = 300_000
    reported = device.read().temperature / 340.0 + 36.53
    assert reported == pytest.approx(25.0 + 6.0 * (1.0 - math.exp(-1.0)), abs=2e-3)


def test_the_bias_follows_the_temperature_in_a_straight_line() -> None:
    level = replace(NONE, gyro_tempco_deg_s_c=5.0, accel_tempco_mg_c=50.0)
    body = Scripted()
    device = chip(body, level)
    cold = device.read()
    slopes, accel_slopes = [], []
    for tick_ms in (100_000, 300_000, 3_000_000):
        body.tick_ms = tick_ms
        warm = device.read()
        rise_c = (warm.temperature - cold.temperature) / 340.0
        slopes.append((warm.gyro_z - cold.gyro_z) / 131.0 / rise_c)
        accel_slopes.append((warm.accel_x - cold.accel_x) / 16384.0 / rise_c)
    assert cold.gyro_z == 0
    assert 0.1 < abs(slopes[0]) <= 5.0
    assert slopes == pytest.approx([slopes[0]] * 3, rel=0.01)
    assert accel_slopes == pytest.approx([accel_slopes[0]] * 3, rel=0.01)
    assert abs(accel_slopes[0]) <= 0.05


def test_warming_changes_the_typical_bias_less_in_a_lane_than_motion() -> None:
    """After a calibration, the main error is the motion bias of 0.01 °/s. A lane takes 20 s."""
    typical = NOISE_LEVELS["typical"]
    fastest_c_s = 6.0 / 300.0
    assert typical.gyro_tempco_deg_s_c * fastest_c_s * 20.0 < 0.2 * typical.gyro_motion_bias_deg_s


# Axes and scale.


def test_one_axis_shows_in_the_others_within_the_datasheets_two_per_cent() -> None:
    level = replace(NONE, gyro_cross_axis=0.02, accel_cross_axis=0.02)
    shares, gravity = [], []
    for seed in range(40):
        reported = {}
        for rate in (100.0, 200.0):
            body = turning(rate)
            reported[rate] = read(body, chip(body, level, seed=seed), 1)[0]
        assert reported[200.0].gyro_z == round(200.0 * 131.0)
        assert reported[200.0].gyro_x == pytest.approx(2 * reported[100.0].gyro_x, abs=2)
        shares += [reported[200.0].gyro_x / 26200.0, reported[200.0].gyro_y / 26200.0]
        gravity += [reported[200.0].accel_x / 16384.0, reported[200.0].accel_y / 16384.0]
        assert reported[200.0].accel_z == 16384
    for values in (shares, gravity):
        assert max(map(abs, values)) <= 0.0201
        # A uniform distribution in ±2 % has σ = 2 %/√3. From 80 values its error is about 5 %.
        assert np.std(values) == pytest.approx(0.02 / math.sqrt(3.0), rel=0.2)


def test_scale_is_within_its_tolerance() -> None:
    level = replace(NONE, gyro_scale_error=0.03)
    found = []
    for seed in range(40):
        body = turning(200.0)
        found.append(read(body, chip(body, level, seed=seed), 1)[0].gyro_z / 26200.0 - 1.0)
    assert max(map(abs, found)) <= 0.0301
    assert max(map(abs, found)) > 0.02


# Faults.


def test_frozen_registers_repeat_and_then_continue() -> None:
    faults = SensorFaults()
    body = Scripted(heading_deg=lambda t: 20.0 * t * t)
    device = chip(body, faults=faults)
    held = read(body, device, 5)[-1]
    faults.imu_frozen = True
    assert read(body, device, 50) == [held] * 50
    faults.imu_frozen = False
    # The expected value is the mean rate between 0.55 s and 0.56 s.
    assert read(body, device, 1)[0].gyro_z == round(40.0 * 0.555 * 131.0)


def test_a_biased_chip_adds_it_before_it_saturates() -> None:
    faults = SensorFaults()
    body = turning(240.0)
    device = chip(body, faults=faults)
    faults.gyro_bias_deg_s = (1.0, -2.0, 20.0)
    faults.accel_bias_g = (0.1, 0.0, -0.5)
    reported = read(body, device, 1)[0]
    assert reported[4:] == (131, -262, 32767)
    assert reported[:3] == (round(0.1 * 16384.0), 0, 8192)
    faults.gyro_bias_deg_s = (0.0, 0.0, -3.0)
    assert read(body, device, 1)[0][4:] == (0, 0, round(237.0 * 131.0))
    faults.gyro_bias_deg_s = (0.0, 0.0, 0.0)
    faults.accel_bias_g = (0.0, 0.0, 0.0)
    assert read(body, device, 1)[0] == (
        0,
        0,
        16384,
        reported.temperature,
        0,
        0,
        round(240.0 * 131.0),
    )


def test_a_lift_is_ten_centimetres_up_and_eight_degrees_and_comes_down_again() -> None:
    faults = SensorFaults()
    body = Scripted()
    device = chip(body, faults=faults)
    before = read(body, device, 3)[-1]
    faults.lifted = True
    up = read(body, device, 60)
    pitch_deg = np.cumsum([0.01 * t.gyro_y / 131.0 for t in up])
    pull_g = [math.hypot(t.accel_x, t.accel_z) / 16384.0 - 1.0 for t in up]
    speed = np.cumsum(pull_g) * 9.80665 * 0.01
    assert pitch_deg[-1] == pytest.approx(-8.0, abs=0.02)
    assert speed[-1] == pytest.approx(0.0, abs=2e-3)
    # The lift of 0.1 m takes two equal halves of 0.2 s, so the speed in the middle is 0.5 m/s.
    assert max(speed) == pytest.approx(0.5, abs=0.01)
    assert float(np.sum(speed)) * 0.01 == pytest.approx(0.1, abs=2e-3)
    assert up[-1].accel_x == round(16384.0 * math.sin(math.radians(8.0)))
    faults.lifted = False
    down = read(body, device, 60)
    assert sum(0.01 * t.gyro_y / 131.0 for t in down) == pytest.approx(8.0, abs=0.02)
    assert down[-1]._replace(temperature=before.temperature) == before


def test_equal_seeds_read_equally_and_others_do_not() -> None:
    def run(seed: int) -> list[ImuCounts]:
        body = turning(10.0)
        return read(body, chip(body, NOISE_LEVELS["harsh"], seed=seed), 2000)

    assert run(3) == run(3)
    assert run(3) != run(4)
