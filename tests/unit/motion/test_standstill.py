"""The conditions of a standstill, and the batches of gyro samples that measure the bias."""

from __future__ import annotations

import pytest

from bridge.motion.estimation.standstill import BATCH, Standstill, StandstillTuning

PERIOD_S = 0.01
BIAS_RAD_S = 0.02


def stand(standstill: Standstill, samples: int, begin_s: float = 0.0) -> list[float]:
    """Give samples of a robot that stands; return the measured biases."""
    measured = []
    for number in range(samples):
        t_s = begin_s + number * PERIOD_S
        standstill.on_encoders(t_s, moved=False)
        mean = standstill.on_gyro(t_s, BIAS_RAD_S, BIAS_RAD_S)
        assert standstill.at_rest
        if mean is not None:
            measured.append(mean)
    return measured


def test_the_wheels_stand_until_the_first_count_and_after_the_settling_time() -> None:
    standstill = Standstill()
    assert standstill.wheels_stand(0.0)
    standstill.on_encoders(1.0, moved=True)
    standstill.on_encoders(1.29, moved=False)
    assert not standstill.wheels_stand(1.29)
    assert standstill.wheels_stand(1.3)


def test_old_encoder_samples_do_not_show_a_standstill() -> None:
    standstill = Standstill()
    standstill.on_encoders(0.0, moved=False)
    assert standstill.wheels_stand(0.19)
    assert not standstill.wheels_stand(0.2)


@pytest.mark.parametrize(("samples", "limit_rad_s"), [(24, 0.4), (25, BIAS_RAD_S + 0.05)])
def test_the_limit_of_the_gyro_is_narrow_from_the_25th_sample(
    samples: int, limit_rad_s: float
) -> None:
    for rate_rad_s, rests in ((limit_rad_s - 1e-6, True), (limit_rad_s + 1e-6, False)):
        standstill = Standstill()
        stand(standstill, samples)
        standstill.on_gyro(samples * PERIOD_S, rate_rad_s, BIAS_RAD_S)
        assert standstill.at_rest is rests


def test_a_batch_counts_only_when_the_next_one_is_complete() -> None:
    standstill = Standstill()
    assert stand(standstill, 2 * BATCH - 1) == []
    assert stand(standstill, 1, 0.1) == [pytest.approx(BIAS_RAD_S)]
    standstill.on_gyro(0.11, 1.0, BIAS_RAD_S)
    assert stand(standstill, 2 * BATCH - 1, 0.12) == []


def test_a_start_before_the_25th_sample_discards_the_earlier_samples() -> None:
    known = []
    standstill = Standstill()
    stand(standstill, StandstillTuning().first_bias_samples - 1)
    standstill.on_gyro(0.24, 1.0, BIAS_RAD_S)
    stand(standstill, StandstillTuning().first_bias_samples - 1, 0.25)
    known.append(standstill.bias_known)
    stand(standstill, 1, 0.5)
    known.append(standstill.bias_known)
    standstill.on_gyro(0.51, 1.0, BIAS_RAD_S)
    known.append(standstill.bias_known)
    assert known == [False, True, True]
