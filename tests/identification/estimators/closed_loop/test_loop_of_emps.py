"""EMPS: mass, friction and simulation errors that the authors publish, from the closed loop simulated again.

Their simulation errors are those of their scripts: measured position through a Butterworth filter of fourth order and
100 Hz, forward and backward, and two central differences; the simulated motion as it is; without the first 50 samples.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, filtfilt

from identification.data.recording import Recording
from identification.data.signals import process
from identification.estimators.closed_loop.didim import didim
from identification.estimators.closed_loop.loop import Feedback, loop_of, simulated
from identification.estimators.closed_loop.plant import plant_of
from identification.estimators.fit import Fit
from identification.estimators.iv import hausman_test, iv
from identification.regression.regressor import Regressor, torque_regressor
from phantom_dyn import load_robot
from phantom_dyn.effects.catalogue import effect_named

# M, Fv, Fc; then the errors of position, velocity, acceleration and force [%].
PUBLISHED = np.array([95.1089, 203.5034, 20.3935])
PUBLISHED_ERRORS = np.array([0.0138, 0.229, 8.60, 5.85])
KP, KV, GAIN = 160.18, 243.45, 35.1507  # [1/s], [V s/m], [N/V]


@pytest.fixture(scope="module")
def raw(data_folder: Path) -> dict[str, np.ndarray]:
    return dict(np.load(data_folder / "emps" / "emps_train.npz"))


@pytest.fixture(scope="module")
def regressor(raw) -> Regressor:
    emps = load_robot("emps")
    q, force, q_ref = (raw[name][:, None] for name in ("q_meas", "force", "q_ref"))
    recording = Recording("emps", emps.joint_names, raw["t"], q, force, q_ref=q_ref)
    names = ("viscous_friction", "coulomb_friction", "torque_offset")
    return torque_regressor(emps, process(recording, emps), [(effect_named(name), "axis") for name in names])


def feedback(delay: float = 0.0) -> Feedback:
    """The recorded controller: the velocity is the backward difference of the mean of two samples."""
    kd = np.array([KV * GAIN])
    return Feedback(KP * kd, kd, np.array([10 * GAIN]), delay, held=True, window=2)


@pytest.fixture(scope="module")
def by_instruments(regressor) -> Fit:
    return iv(regressor, feedback=feedback())


@pytest.fixture(scope="module")
def by_simulation(regressor) -> Fit:
    return didim(regressor, feedback=feedback())


def simulation_errors(regressor: Regressor, raw: dict, fit: Fit, delay: float) -> np.ndarray:
    """Errors of position, velocity, acceleration and force [%] as the authors define them."""
    loop = loop_of(regressor.robot, regressor.logs[0], feedback(delay))
    motion, tau = simulated(loop, plant_of(regressor, fit.base, fit.theta))
    q, v, force = motion.q[:, 0], motion.v[:, 0], tau[:, 0]
    M, viscous, dry, offset = fit.theta
    # Theirs is the acceleration at the instant of a sample, where a held force has just changed.
    a = (force - viscous * v - dry * np.sign(v) + offset) / M
    position = filtfilt(*butter(4, 100 / 500), raw["q_meas"])
    velocity = np.gradient(position, 1e-3)
    measured = (position, velocity, np.gradient(velocity, 1e-3), raw["force"])
    pairs = zip(measured, (q, v, a, force), strict=True)
    return np.array([100 * np.linalg.norm((x - y)[49:]) / np.linalg.norm(x[49:]) for x, y in pairs])


def test_instruments_find_the_published_mass_and_friction_within_one_per_cent(by_instruments):
    np.testing.assert_allclose(by_instruments.theta[:3], PUBLISHED, rtol=0.01)


def test_direct_and_inverse_finds_the_published_mass_and_friction_within_one_per_cent(by_simulation):
    np.testing.assert_allclose(by_simulation.theta[:3], PUBLISHED, rtol=0.01)


def test_the_controller_that_we_simulate_is_the_recorded_one(raw):
    # Known truth: the recorded voltage, from recorded reference and position, to its noise of 0.2 %.
    q = raw["q_meas"]
    u = KP * KV * (raw["q_ref"] - q)[2:] - KV * (q[2:] - q[:-2]) / 2e-3
    assert np.std((u - raw["u_volt"][2:])[10:]) < 0.004 * np.std(raw["u_volt"])


@pytest.mark.parametrize("name", ["by_instruments", "by_simulation"])
def test_a_controller_late_by_one_sample_has_the_published_simulation_errors(name, regressor, raw, request):
    # Published, within 20 %; of the position a tenth: 0.0138 % of 0.149 m are 0.02 mm, for which this controller
    # asks for 28 N, and the published error of the force is 3 N.
    errors = simulation_errors(regressor, raw, request.getfixturevalue(name), delay=1e-3)
    np.testing.assert_allclose(errors, PUBLISHED_ERRORS * [0.1, 1, 1, 1], rtol=0.2)


@pytest.mark.parametrize("name", ["by_instruments", "by_simulation"])
def test_the_recorded_controller_beats_every_published_simulation_error(name, regressor, raw, request):
    errors = simulation_errors(regressor, raw, request.getfixturevalue(name), delay=0.0)
    assert np.all(errors < 0.8 * PUBLISHED_ERRORS)


def test_the_fine_encoder_does_not_bias_least_squares_by_much(regressor):
    # Published: least squares and instrumental variables agree on this axis.
    assert np.all(np.abs(hausman_test(regressor, feedback=feedback()).difference[:3]) < 0.005 * PUBLISHED)
