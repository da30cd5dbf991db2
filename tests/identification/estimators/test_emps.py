"""EMPS: the estimates that the authors of the benchmark publish, from their recording, with the band chosen by us."""

from pathlib import Path

import numpy as np
import pytest

from identification.data.log import Log
from identification.data.recording import Recording
from identification.data.signals import process
from identification.estimators.weighted_least_squares import ols, wls
from identification.regression.regressor import torque_regressor
from phantom_dyn import load_robot
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.robot import Robot

SYMMETRIC = [(effect_named(name), "axis") for name in ("viscous_friction", "coulomb_friction", "torque_offset")]
DIRECTIONAL = [(effect_named("direction_dependent_friction"), "axis")]


@pytest.fixture(scope="module")
def emps() -> Robot:
    return load_robot("emps")


@pytest.fixture(scope="module")
def recording(emps: Robot, data_folder: Path) -> Recording:
    data = np.load(data_folder / "emps" / "emps_train.npz")
    return Recording("emps", emps.joint_names, data["t"], data["q_meas"][:, None], data["force"][:, None])


@pytest.fixture(scope="module")
def log(emps: Robot, recording: Recording) -> Log:
    return process(recording, emps)


def test_the_published_mass_and_friction_come_back_within_half_a_per_cent(emps, log):
    # Published: M, Fv, Fc.
    theta = ols(torque_regressor(emps, log, SYMMETRIC)).theta
    np.testing.assert_allclose(theta[:3], [95.1089, 203.5034, 20.3935], rtol=0.005)


def test_the_published_offset_comes_back_within_0_2_newton(emps, log):
    # Published: -3.1648 N added to the force; our offset is the torque that the drive has to cancel.
    assert ols(torque_regressor(emps, log, SYMMETRIC)).theta[3] == pytest.approx(3.1648, abs=0.2)


def test_the_published_relative_error_comes_back_within_0_2_points(emps, log):
    assert ols(torque_regressor(emps, log, SYMMETRIC)).relative_error[0] == pytest.approx(4.0834, abs=0.2)


def test_the_published_direction_dependent_friction_comes_back_within_half_a_per_cent(emps, log):
    # Published: M, Fc+, Fc-, Fv+, Fv- in the order of our coefficients.
    theta = ols(torque_regressor(emps, log, DIRECTIONAL)).theta
    np.testing.assert_allclose(theta, [95.1540, 20.1440, 20.6277, 166.7061, 240.4236], rtol=0.005)


def test_the_published_error_of_direction_dependent_friction_comes_back_within_0_2_points(emps, log):
    assert ols(torque_regressor(emps, log, DIRECTIONAL)).relative_error[0] == pytest.approx(3.1117, abs=0.2)


@pytest.mark.parametrize("factor", [0.8, 1.2])
def test_a_band_one_fifth_off_changes_nothing_of_this(emps, recording, log, factor):
    other = process(recording, emps, cutoff_hz=factor * log.band.cutoff_hz)
    theta = ols(torque_regressor(emps, other, SYMMETRIC)).theta
    np.testing.assert_allclose(theta[:3], [95.1089, 203.5034, 20.3935], rtol=0.005)


def test_the_published_values_lie_within_two_deviations(emps, log):
    fit = wls(torque_regressor(emps, log, SYMMETRIC))
    assert np.all(np.abs(fit.theta - [95.1089, 203.5034, 20.3935, 3.1648]) < 2 * fit.std())
