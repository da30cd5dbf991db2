"""Friction over the pretension of a cable: known truth from simulated friction tests, numpy's own line."""

from __future__ import annotations

import math

import numpy as np
import pytest

from identification.excitation.motion_shapes import Triangle
from identification.experiments.cable_pretension import fit_pretension
from identification.experiments.constant_speed_friction import fit_steady
from phantom_dyn.devices.cable_friction import CableFriction
from phantom_dyn.errors import IdentifiabilityError, ParameterError

PULLED = np.array([20.0, 30.0, 45.0, 60.0])


def measured(rng, pretension: float, *, rest: float = 0.0) -> tuple[float, float]:
    """Coulomb torque and deviation from triangles of three speeds, of a joint of 3 mm of friction per pretension."""
    motions = [Triangle(0.5, f).motion(np.arange(0, 3 / f, 0.002)) for f in (0.1, 0.3, 0.9)]
    q, v, a = np.concatenate(motions, axis=1)
    law = CableFriction(3e-3)
    tau = law.torque(np.full(len(v), pretension), v) + rest * np.sign(v) + 0.02 * v + 0.01 * np.sin(q)
    fit, _, _ = fit_steady(q, v, a, tau + 0.01 * rng.normal(size=len(v)), ("FV", "FC"), ("N m s/rad", "N m"))
    return fit.value("FC")


def test_simulated_tests_give_the_ratio_back_and_say_that_friction_is_proportional(rng):
    coulomb, std = np.transpose([measured(rng, P) for P in PULLED])
    found = fit_pretension(PULLED, coulomb, std)
    assert found.proportional
    value, deviation = found.through_origin
    assert abs(value - 3e-3) < 4 * deviation
    assert found.law().ratio == value
    assert deviation < 0.01 * value


def test_friction_of_bearings_is_told_from_that_of_the_cable(rng):
    coulomb, std = np.transpose([measured(rng, P, rest=0.05) for P in PULLED])
    found = fit_pretension(PULLED, coulomb, std)
    assert not found.proportional
    assert abs(found.rest[0] - 0.05) < 4 * found.rest[1]
    assert abs(found.ratio[0] - 3e-3) < 4 * found.ratio[1]
    with pytest.raises(IdentifiabilityError, match="not proportional to the pretension"):
        found.law()


def test_the_line_is_that_of_numpy(rng):
    coulomb, std = 0.02 + 3e-3 * PULLED + 1e-3 * rng.normal(size=4), np.array([1e-3, 2e-3, 1e-3, 3e-3])
    found = fit_pretension(PULLED, coulomb, std)
    (slope, rest), cov = np.polyfit(PULLED, coulomb, 1, w=1 / std, cov="unscaled")
    assert (found.ratio[0], found.rest[0]) == pytest.approx((slope, rest), rel=1e-10)
    assert (found.ratio[1], found.rest[1]) == pytest.approx(tuple(np.sqrt(np.diag(cov))), rel=1e-10)


def test_the_misfit_is_one_where_the_deviations_are_right():
    rng = np.random.default_rng(0)
    pulled = np.linspace(10, 60, 200)
    found = fit_pretension(pulled, 3e-3 * pulled + 1e-3 * rng.normal(size=200), np.full(200, 1e-3))
    assert found.misfit == pytest.approx(1.0, abs=0.3)
    assert math.isnan(fit_pretension(PULLED[:2], np.ones(2), np.ones(2)).misfit)


def test_one_pretension_is_refused():
    with pytest.raises(IdentifiabilityError, match="test it at two or more"):
        fit_pretension(np.array([20.0, 20.0]), np.ones(2), np.ones(2))


def test_a_deviation_of_nothing_is_refused():
    with pytest.raises(ParameterError, match="The deviation of the tests"):
        fit_pretension(PULLED, np.ones(4), np.array([1.0, 1.0, 0.0, 1.0]))
