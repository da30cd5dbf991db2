"""Derivatives of sampled motions; oracle: a polynomial in closed form."""

import numpy as np

from phantom_dyn.signals.splines import quintic_derivatives


def test_derivatives_of_a_polynomial_of_fifth_degree_are_exact():
    t = np.arange(60) / 200.0
    law = np.polynomial.Polynomial([0.3, -1.0, 2.0, 5.0, -7.0, 11.0])
    slope, bend = quintic_derivatives(law(t)[:, None], 200.0)
    np.testing.assert_allclose(slope[:, 0], law.deriv()(t), atol=1e-8)
    np.testing.assert_allclose(bend[:, 0], law.deriv(2)(t), atol=1e-5)
