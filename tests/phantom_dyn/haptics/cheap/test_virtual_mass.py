from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import butter

from phantom_dyn.haptics.cheap.cheap_cycle import butterworth_weights, low_passed, mass_step


@pytest.mark.parametrize(
    ("rate", "b", "a"), [(500, 0.319989, -0.360022), (1000, 0.182690, -0.634619), (2000, 0.099424, -0.801151)]
)
def test_weights_of_the_filter_are_the_published_ones(rate, b, a):
    # Published figures, and scipy's own design.
    assert butterworth_weights(1.0 / rate, 70.0) == (pytest.approx(b, abs=5e-7), pytest.approx(a, abs=5e-7))
    numerator, denominator = np.array(butter(1, 70.0, fs=rate))
    np.testing.assert_allclose(butterworth_weights(1.0 / rate, 70.0), [numerator[1], denominator[1]], rtol=1e-12)


def test_a_constant_passes_the_filter_at_any_sequence_of_steps(rng):
    # Closed form: unit gain at zero frequency, whatever the steps.
    out = 3.0
    for dt in rng.uniform(1 / 2000, 1 / 500, 100):
        out = low_passed(out, 3.0, 3.0, dt, 70.0)
    assert out == pytest.approx(3.0, rel=1e-12)


def test_a_mass_on_its_coupling_swings_as_the_closed_form_says(rng):
    # Known truth: scipy's integrator on the same equation; steps between 0.5 and 2 ms.
    mass, stiffness, damping = 0.1, 150.0, 1.5
    x, v, t = 0.004, 0.0, 0.0
    for dt in rng.uniform(1 / 2000, 1 / 500, 200):
        x, v = mass_step(x, v, dt, mass, 0.0, stiffness, damping, 0.0)
        t += dt
    true = solve_ivp(
        lambda _, y: [y[1], -(stiffness * y[0] + damping * y[1]) / mass], (0, t), [0.004, 0.0], rtol=1e-10, atol=1e-14
    ).y[:, -1]
    # The phase of the midpoint rule is right to a twelfth of (w h)^2, 1e-4 here, of some ten radians.
    np.testing.assert_allclose(
        [x, v / np.sqrt(stiffness / mass)], [true[0], true[1] / np.sqrt(stiffness / mass)], atol=2e-3 * 0.004
    )


def test_no_stiffness_makes_the_mass_unstable():
    # A thousand times what the explicit rule would bear at 1 ms.
    x, v = 0.001, 0.0
    for _ in range(2000):
        x, v = mass_step(x, v, 1e-3, 0.1, 0.0, 4e8, 0.0, 0.0)
    assert abs(x) <= 0.001 * (1 + 1e-9)
