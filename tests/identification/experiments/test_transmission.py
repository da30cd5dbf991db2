from __future__ import annotations

import numpy as np
import pytest

from identification.experiments.transmission import Loop, blocked_arm_loop, fit_transmission, triangular_torque
from phantom_dyn.devices.cea import STIFFNESS_UNITS, TRANSMISSION_STIFFNESS
from phantom_dyn.errors import IdentifiabilityError, LogError, ParameterError

FREQUENCIES = (0.05, 0.2, 0.8)
STIFFNESS = TRANSMISSION_STIFFNESS["K1"].value * STIFFNESS_UNITS["N m/mrad"]  # published, in the possible reading


def loop(frequency=0.2, *, stiffness=STIFFNESS, damping=0.0, coulomb=0.12, amplitude=1.5) -> Loop:
    t = np.arange(0, 3 / frequency, 0.002)
    torque = triangular_torque(t, amplitude, frequency)
    return blocked_arm_loop(t, torque, stiffness=stiffness, damping=damping, coulomb=coulomb)


def noisy(clean: Loop, rng) -> Loop:
    shape = clean.t.shape
    return Loop(
        clean.t, clean.torque + 0.01 * rng.normal(size=shape) + 0.02, clean.position + 1e-6 * rng.normal(size=shape)
    )


def test_without_friction_and_damping_the_arm_is_a_spring():
    clean = loop(coulomb=0.0)
    np.testing.assert_allclose(clean.position, clean.torque / STIFFNESS, atol=1e-15)


def test_dry_friction_opens_the_loop_by_twice_its_torque():
    # Closed form: on the way up the spring carries the torque less 0.12 N m, on the way down 0.12 N m more.
    clean = loop()
    spring, v = STIFFNESS * clean.position, np.gradient(clean.position)
    up, down = v > 0.5 * v.max(), v < 0.5 * v.min()
    np.testing.assert_allclose((clean.torque - spring)[up], 0.12, atol=1e-12)
    np.testing.assert_allclose((clean.torque - spring)[down], -0.12, atol=1e-12)


def test_the_work_of_a_cycle_is_that_of_dry_friction():
    # Closed form: 4 C (amplitude - C) / K, the area of the parallelogram.
    t = np.arange(0, 10, 0.001)
    torque = triangular_torque(t, 1.5, 0.2)
    clean = blocked_arm_loop(t, torque, stiffness=STIFFNESS, damping=0.0, coulomb=0.12)
    last = t >= 5 - 1e-9  # one period, after the first has led onto the loop
    work = np.trapezoid(clean.torque[last], clean.position[last])
    assert work == pytest.approx(4 * 0.12 * (1.5 - 0.12) / STIFFNESS, rel=0.01)


def test_damping_lags_as_a_first_order_system():
    # Closed form: after a step, dq = (torque / K) (1 - exp(-t K / B)).
    t = np.arange(0, 0.5, 1e-5)
    clean = blocked_arm_loop(t, np.ones_like(t), stiffness=100.0, damping=10.0, coulomb=0.0)
    np.testing.assert_allclose(clean.position, 0.01 * (1 - np.exp(-10 * (t + 1e-5))), atol=1e-6)


@pytest.mark.parametrize("damping", [0.0, 5.0])
def test_stiffness_damping_friction_and_offset_are_found(rng, damping):
    # Known truth; four deviations for four unknowns.
    fit = fit_transmission([noisy(loop(f, damping=damping), rng) for f in FREQUENCIES], cutoff_hz=10.0)
    assert fit.names == ("K", "B", "C", "offset")
    assert (np.abs(fit.theta - [STIFFNESS, damping, 0.12, 0.02]) < 4 * fit.std()).all()


def test_the_stiffness_is_at_least_as_certain_as_the_published_one(rng):
    # Published: 0.3 to 0.5 % in Table 2.
    fit = fit_transmission([noisy(loop(f), rng) for f in FREQUENCIES], cutoff_hz=10.0)
    assert fit.relative_std()[0] < min(K.deviation for K in TRANSMISSION_STIFFNESS.values())


def test_loops_of_one_rate_hardly_part_damping_from_dry_friction(rng):
    one = fit_transmission([noisy(loop(0.2), rng)], cutoff_hz=10.0)
    several = fit_transmission([noisy(loop(f), rng) for f in FREQUENCIES], cutoff_hz=10.0)
    assert one.scaled_condition > 3 * several.scaled_condition


def test_a_torque_below_dry_friction_is_refused():
    with pytest.raises(LogError, match="does not move against the blocked arm: give more torque than its dry friction"):
        fit_transmission([loop(amplitude=0.1)], cutoff_hz=10.0)


def test_motion_in_one_direction_is_refused():
    t = np.arange(0, 4, 0.002)
    clean = blocked_arm_loop(t, t, stiffness=STIFFNESS, damping=0.0, coulomb=0.12)
    with pytest.raises(IdentifiabilityError, match="does not part the unknowns K, B, C, offset"):
        fit_transmission([clean], cutoff_hz=10.0)


def test_a_negative_stiffness_is_refused():
    with pytest.raises(ParameterError, match="stiffness -1, damping 0 and friction 0 was asked for: give a positive"):
        loop(stiffness=-1.0, coulomb=0.0)
