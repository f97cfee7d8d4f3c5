"""The filter's joint covariance, with results by hand: states are added, updated and held."""

from __future__ import annotations

import numpy as np
import pytest

from bridge.motion.estimation.joint_covariance import JointCovariance


def test_an_augmented_state_is_correlated_with_its_sources() -> None:
    joint_covariance = JointCovariance((4.0, 1.0))
    first = joint_covariance.augment((0,), np.array([[1.0]]), np.array([[0.5]]))
    assert first == 2
    assert joint_covariance.p[2, 2] == pytest.approx(4.5)
    assert joint_covariance.p[0, 2] == pytest.approx(4.0)
    # An unchanged difference of two states gives no information about either state.
    joint_covariance.update((0, 2), np.array([[1.0, -1.0]]), np.zeros(1), np.array([[1e-9]]))
    assert joint_covariance.p[0, 0] == pytest.approx(4.0)
    joint_covariance.marginalise(2, 1)
    assert joint_covariance.size == 2


def test_an_update_is_kalmans() -> None:
    joint_covariance = JointCovariance((4.0,))
    step = joint_covariance.update((0,), np.array([[2.0]]), np.array([1.0]), np.array([[9.0]]))
    assert step[0] == pytest.approx(4.0 * 2.0 / 25.0)
    assert joint_covariance.p[0, 0] == pytest.approx(4.0 - 8.0 * 8.0 / 25.0)


def test_a_held_state_counts_with_its_variance_and_stays() -> None:
    """Schmidt's filter by hand: s = 4 + 1 + 4; the gains are 4/9, and 0 for the held state."""
    joint_covariance = JointCovariance((4.0, 1.0))
    row = np.array([[1.0, 1.0]])
    step = joint_covariance.update((0, 1), row, np.array([9.0]), np.array([[4.0]]), held=(1,))
    assert step == pytest.approx([4.0, 0.0])
    assert joint_covariance.p == pytest.approx(
        np.array([[4.0 - 16.0 / 9.0, -4.0 / 9.0], [-4.0 / 9.0, 1.0]])
    )
    # Joseph's form (I - KH) P (I - KH)' + KRK' is valid for any gain K.
    gain = np.array([[4.0 / 9.0], [0.0]])
    keep = np.eye(2) - gain @ row
    joseph = keep @ np.diag([4.0, 1.0]) @ keep.T + 4.0 * gain @ gain.T
    assert joint_covariance.p == pytest.approx(joseph)


def test_the_correlation_of_two_held_states_stays() -> None:
    """For any covariance, the result equals Joseph's form with zero gains for the held states."""
    rng = np.random.default_rng(1)
    root = rng.normal(size=(5, 5))
    joint_covariance = JointCovariance((1.0,) * 5)
    before = joint_covariance.p = root @ root.T
    row, noise = rng.normal(size=(1, 5)), np.array([[0.7]])
    gain = before @ row.T / float((row @ before @ row.T)[0, 0] + 0.7)
    gain[[1, 3]] = 0.0
    keep = np.eye(5) - gain @ row
    joseph = keep @ before @ keep.T + gain @ noise @ gain.T
    step = joint_covariance.update(range(5), row, np.array([2.0]), noise, held=(1, 3))
    assert joint_covariance.p == pytest.approx(joseph)
    assert step == pytest.approx(2.0 * gain[:, 0])
