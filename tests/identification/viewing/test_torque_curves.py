"""Torque of a recording beside its models. Oracles: known friction, closed forms of sines and constants."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.viewing.torque_curves import TorqueCurves, full_colour, relative_residuals, torque_curves


@pytest.fixture(scope="module")
def curves(rubbing, lacking):
    robot = rubbing.robot
    return torque_curves(rubbing.log, rubbing.cutoff_hz, ((robot, ()), (robot, (lacking,))))


def test_the_residual_of_the_given_model_is_the_friction_that_it_lacks(rubbing, lacking, curves):
    # Away from reversals; the band rounds the steps of Coulomb's law off, about which it overshoots both ways.
    v = np.array([np.interp(curves.t, rubbing.log.motion.t, column) for column in rubbing.log.motion.v.T]).T[:, 1]
    fast = np.isfinite(curves.measured[:, 1]) & (np.abs(v) > 1.5)
    assert fast.sum() > 100
    along = curves.residual(0)[fast, 1] * np.sign(v[fast])
    assert along.mean() == pytest.approx(lacking.theta[0], rel=0.1)
    assert along.std() < 0.15 * lacking.theta[0]


def test_the_residual_of_the_corrected_model_is_small(lacking, curves):
    assert np.sqrt(np.nanmean(curves.residual(1)[:, 1] ** 2)) < 0.05 * lacking.theta[0]


def test_curves_are_drawn_with_twelve_samples_in_the_period_of_the_band(rubbing):
    t = torque_curves(rubbing.log, 8.0, ((rubbing.robot, ()),)).t
    assert np.median(np.diff(t)) == pytest.approx(0.01)  # 96 Hz at least, as every second of 200 Hz


def test_nothing_is_drawn_where_the_recording_must_not_be_used(rubbing):
    t = rubbing.log.motion.t
    log = replace(rubbing.log, valid=(t < 4.0) | (t > 5.0))
    found = torque_curves(log, rubbing.cutoff_hz, ((rubbing.robot, ()),))
    inside = (found.t > 4.0) & (found.t < 5.0)
    assert np.isnan(found.measured[inside]).all()
    assert np.isfinite(found.measured[found.t < 3.0]).all()


def test_a_constant_residual_is_its_share_of_the_root_mean_square():
    t = np.arange(1000) / 100.0
    measured = np.sqrt(2.0) * 3.0 * np.sin(2 * np.pi * t)[:, None]  # root mean square 3 over whole periods
    (share,) = relative_residuals(TorqueCurves(t, measured, (measured - 0.6,)))
    np.testing.assert_allclose(share, 0.2, rtol=1e-9)


def test_a_joint_without_torque_has_no_share():
    t, none = np.arange(100) / 100.0, np.zeros((100, 1))
    (share,) = relative_residuals(TorqueCurves(t, none, (none,)))
    np.testing.assert_array_equal(share, 0.0)


@pytest.mark.parametrize(("share", "full"), [(0.3, 0.3), (0.01, 0.1), (5.0, 1.0)])
def test_the_full_colour_is_the_largest_residual_between_a_tenth_and_all_of_the_torque(share, full):
    assert full_colour(np.full((100, 2), share)) == pytest.approx(full)


def test_one_spike_does_not_set_the_full_colour():
    shares = np.full((1000, 1), 0.3)
    shares[5] = 0.9
    assert full_colour(shares) == pytest.approx(0.3)
