from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from identification.engine.autocorrelation import samples_per_independent
from identification.estimators.linear.least_squares import base_of, solve
from identification.estimators.linear.scatter import (
    autocorrelation,
    coloured_scatter,
    joint_noise,
    scatter_of_rows,
    white_scatter,
)
from identification.estimators.weighted_least_squares import ols
from identification.regression.regressor import gap_regressor
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named

TRUTH = np.array([0.4, 0.6, -0.3])


def coverage(pendulum, motion, make_log, noise) -> tuple[float, float]:
    """Share of 95 % intervals that hold the truth: with the memory of the residual, and with the white formula."""
    effects = [(effect_named(f"{name}"), "pin") for name in ("viscous_friction", "coulomb_friction", "torque_offset")]
    clean = inverse_dynamics(pendulum, motion) + np.column_stack([motion.v, np.sign(motion.v), -motion.v**0]) @ [
        [0.4], [0.6], [-0.3]
    ]  # fmt: skip
    inside, white = [], []
    for draw in noise:
        fit = ols(gap_regressor(pendulum, make_log(pendulum, motion, clean + draw[:, None]), effects))
        error = np.abs(fit.theta - TRUTH)
        inside.append(error < 1.96 * fit.std())
        white.append(error < 1.96 * np.sqrt(np.diag(fit.cov_white)))
    return float(np.mean(inside)), float(np.mean(white))


@pytest.mark.whole
def test_intervals_hold_the_truth_in_95_per_cent_of_draws(pendulum, swing, make_log, rng):
    motion = swing(pendulum, 300)
    coloured, white = coverage(pendulum, motion, make_log, 0.2 * rng.normal(size=(200, 300)))
    assert 0.92 < white < 0.98
    assert 0.92 < coloured < 0.99


@pytest.mark.whole
def test_intervals_hold_the_truth_with_noise_that_has_a_memory(pendulum, swing, make_log, rng):
    # First-order autoregression with a memory of ten samples: the white formula is far off.
    motion = swing(pendulum, 600)
    noise = lfilter([1.0], [1.0, -0.9], 0.1 * rng.normal(size=(150, 1600)), axis=1)[:, 1000:]
    coloured, white = coverage(pendulum, motion, make_log, noise)
    assert coloured > 0.90
    assert white < 0.70


def test_the_correlation_factor_of_an_autoregression_is_the_closed_form(rng):
    # Closed form: (1 + a) / (1 - a).
    noise = lfilter([1.0], [1.0, -0.8], rng.normal(size=200_000))
    assert samples_per_independent(autocorrelation(noise, (0, 200_000))) == pytest.approx(9.0, rel=0.1)


def test_the_correlation_factor_of_white_noise_is_one(rng):
    assert samples_per_independent(autocorrelation(rng.normal(size=50_000), (0, 50_000))) == pytest.approx(
        1.0, abs=0.05
    )


def test_noise_that_alternates_is_not_called_better_than_white():
    noise = np.tile([1.0, -1.0], 500)
    assert samples_per_independent(autocorrelation(noise, (0, 1000))) == 1.0


def test_recordings_do_not_remember_each_other():
    # Constant within each recording: the memory reaches over one recording, not over both.
    steps = np.repeat([1.0, -1.0], 100)
    assert len(autocorrelation(steps, (0, 100, 200))) <= 100


def test_the_noise_counts_the_equations_that_are_left_over():
    # Closed form: sum of squares over N minus the parameters used.
    assert joint_noise(np.full((10, 1), 2.0), np.array([6.0]))[0] == pytest.approx(np.sqrt(40 / 4))


def test_no_equation_left_over_means_unknown_noise():
    assert np.isnan(joint_noise(np.zeros((3, 1)), np.array([3.0]))[0])


def test_noise_without_a_memory_gives_the_white_scatter(arm, swing, make_log, rubbing, friction):
    # Closed form: Parseval; the sum over frequencies is the sum over samples.
    motion = swing(arm, 101)
    regressor = gap_regressor(arm, make_log(arm, motion, rubbing(arm, motion)), friction(arm))
    base = base_of(regressor)
    solution = solve(regressor, base, np.ones_like(regressor.y))
    scatter = np.array([1.0, 2.0, 3.0])
    coloured = coloured_scatter(regressor, base, solution, scatter, [np.ones(1)] * 3)
    np.testing.assert_allclose(coloured, white_scatter(solution, scatter), atol=1e-12)


def test_rows_without_a_memory_scatter_by_their_squares(rng):
    # Closed form: the sum over samples and joints of variance times x x^T.
    rows, scatter = rng.normal(size=(50, 2, 3)), np.array([1.0, 4.0])
    found = scatter_of_rows(rows, scatter, [np.ones(1)] * 2)
    np.testing.assert_allclose(found, np.einsum("j,njk,njl->kl", scatter, rows, rows), rtol=1e-12)
