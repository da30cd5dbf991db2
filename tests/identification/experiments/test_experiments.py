"""Experiments on transmissions: pretension, resonance, stiffness."""

import math

import numpy as np
import pytest

from identification.data.log import Band, Log
from identification.data.signals import align_held_torque
from identification.diagnosis.columns.resonances import joint_response
from identification.excitation.motion_shapes import Triangle
from identification.experiments.cable_pretension import fit_pretension
from identification.experiments.constant_speed_friction import fit_steady
from identification.experiments.linear_fit import fit_linear, without_nuisance
from identification.experiments.transmission import Loop, blocked_arm_loop, fit_transmission, triangular_torque
from phantom_dyn.devices.cable_friction import CableFriction
from phantom_dyn.devices.cea import STIFFNESS_UNITS, TRANSMISSION_STIFFNESS
from phantom_dyn.errors import IdentifiabilityError, LogError, ParameterError, RobotError
from phantom_dyn.haptics.device.axis import TwoMassAxis
from phantom_dyn.haptics.experiments.noise_and_sweep import simulate_white_noise
from phantom_dyn.motion import Motion

PULLED = np.array([20.0, 30.0, 45.0, 60.0])


def measured(rng, pretension: float, *, rest: float = 0.0) -> tuple[float, float]:
    """Coulomb torque and deviation from triangles of three speeds, of a joint of 3 mm of friction per pretension."""
    motions = [Triangle(0.5, f).motion(np.arange(0, 3 / f, 0.002)) for f in (0.1, 0.3, 0.9)]
    q, v, a = np.concatenate(motions, axis=1)
    coulomb = CableFriction(3e-3).coulomb(np.array([pretension])) + rest
    tau = coulomb * np.sign(v) + 0.02 * v + 0.01 * np.sin(q)
    fit, _, _ = fit_steady(q, v, a, tau + 0.01 * rng.normal(size=len(v)), ("FV", "FC"), ("N m s/rad", "N m"))
    return fit.value("FC")


def test_simulated_tests_give_the_ratio_back_and_say_that_friction_is_proportional(rng):
    coulomb, std = np.transpose([measured(rng, P) for P in PULLED])
    found = fit_pretension(PULLED, coulomb, std)
    assert found.proportional
    value, deviation = found.through_origin
    assert abs(value - 3e-3) < 4 * deviation
    assert deviation < 0.01 * value


def test_friction_of_bearings_is_distinguished_from_that_of_the_cable(rng):
    coulomb, std = np.transpose([measured(rng, P, rest=0.05) for P in PULLED])
    found = fit_pretension(PULLED, coulomb, std)
    assert not found.proportional
    assert abs(found.rest[0] - 0.05) < 4 * found.rest[1]
    assert abs(found.ratio[0] - 3e-3) < 4 * found.ratio[1]


def test_the_line_is_that_of_the_weighted_closed_form(rng):
    coulomb, std = 0.02 + 3e-3 * PULLED + 1e-3 * rng.normal(size=4), np.array([1e-3, 2e-3, 1e-3, 3e-3])
    found = fit_pretension(PULLED, coulomb, std)
    weight = std**-2
    middle = np.average(PULLED, weights=weight)
    spread = np.sum(weight * (PULLED - middle) ** 2)
    slope = np.sum(weight * (PULLED - middle) * coulomb) / spread
    rest = np.average(coulomb, weights=weight) - slope * middle
    assert found.ratio == pytest.approx((slope, spread**-0.5), rel=1e-10)
    assert found.rest == pytest.approx((rest, np.sqrt(1 / weight.sum() + middle**2 / spread)), rel=1e-10)


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


T = 1e-3

# A joint of a small arm: rotor 0.05 and link 0.2 kg m2, 800 N m/rad: it resonates at 22.5 Hz.
JOINT = TwoMassAxis(0.05, 0.2, 0.1, 0.2, 800.0, 0.3)


def log(rng, *, valid=None, torque=None) -> Log:
    """Torque of the first joint as noise that was held, taken to the instants as `identification.data.signals` does."""
    experiment = simulate_white_noise(JOINT, period=T, force=2.0, position_noise=1e-6, duration=80.0, rng=rng)
    q = np.column_stack([experiment.position, np.zeros_like(experiment.position)])
    tau = np.column_stack([experiment.force, np.ones_like(experiment.force)]) if torque is None else torque
    t = T * np.arange(len(q))
    keep = np.ones(len(t), dtype=bool) if valid is None else valid(t)
    motion = Motion(t, q, np.zeros_like(q), np.zeros_like(q))
    return Log("noise.csv", ("j1", "j2"), motion, align_held_torque(tau), Band(1 / T, 50.0, np.ones(1), 1), keep, q)


def test_only_the_longest_valid_stretch_is_used(rng):
    # Known truth: half of the recording is excluded, and what is there is left alone.
    given = log(rng, valid=lambda t: (t > 20.0) | (t < 5.0))
    broken = given.motion.q.copy()
    broken[given.motion.t < 5.0] = 1e3
    excluded = Log(given.file, given.joint_names, given.motion, given.tau, given.band, given.valid, broken)
    np.testing.assert_array_equal(joint_response(excluded, "j1").response, joint_response(given, "j1").response)


def test_response_ends_at_a_fifth_of_the_rate(rng):
    assert joint_response(log(rng), "j1").frequency[-1] <= 2 * np.pi * 200.0


@pytest.mark.parametrize(
    ("joint", "error", "said"),
    [
        ("elbow", RobotError, r"noise\.csv has no joint 'elbow': it has j1, j2"),
        ("j2", LogError, "the torque of j2 never changes: drive it with noise or a chirp"),
    ],
)
def test_an_unknown_joint_and_a_constant_torque_are_refused(rng, joint, error, said):
    with pytest.raises(error, match=said):
        joint_response(log(rng), joint)


def test_too_short_a_stretch_is_refused(rng):
    with pytest.raises(LogError, match="longest valid stretch has 100 samples"):
        joint_response(log(rng, valid=lambda t: t < 99.5 * T), "j1")


NAMES, UNITS = ("a", "b", "c"), ("N m", "N m", "N m")


def problem(rng, rows=400, noise=0.3):
    W, theta = rng.normal(size=(rows, 3)) * [1, 10, 0.1], np.array([1.0, -2.0, 3.0])
    return W, W @ theta + noise * rng.normal(size=rows), theta


def test_the_estimate_is_that_of_numpy(rng):
    W, y, _ = problem(rng)
    np.testing.assert_allclose(fit_linear(W, y, NAMES, UNITS).theta, np.linalg.lstsq(W, y, rcond=None)[0])


def test_the_covariance_is_equation_6(rng):
    W, y, _ = problem(rng)
    fit = fit_linear(W, y, NAMES, UNITS)
    np.testing.assert_allclose(fit.cov, fit.sigma**2 * np.linalg.inv(W.T @ W))


def test_the_noise_is_found_with_the_square_that_equation_5_lost(rng):
    # Known truth: 0.3 on 20000 rows. As printed, ||Y - WX|| / (r - b) would be 0.0021 for the variance.
    W, y, _ = problem(rng, rows=20000)
    fit = fit_linear(W, y, NAMES, UNITS)
    assert fit.sigma == pytest.approx(0.3, rel=0.02)
    printed = np.linalg.norm(y - W @ fit.theta) / (20000 - 3)
    assert printed < 0.05 * fit.sigma**2


@pytest.mark.nightly
def test_95_per_cent_intervals_hold_the_truth_in_95_per_cent_of_the_draws(rng):
    # Known truth; 1200 intervals, so that the share scatters by 0.6 %.
    inside = []
    for _ in range(400):
        W, y, theta = problem(rng, rows=40)
        fit = fit_linear(W, y, NAMES, UNITS)
        inside.append(np.abs(fit.theta - theta) < 2.026 * fit.std())  # Student's t, 37 degrees of freedom
    assert np.mean(inside) == pytest.approx(0.95, abs=0.025)


def test_rows_with_a_memory_count_for_less(rng):
    # Closed form: every row four times over.
    W, y, _ = problem(rng)
    again = fit_linear(np.repeat(W, 4, axis=0), np.repeat(y, 4), NAMES, UNITS, memory=4.0)
    np.testing.assert_allclose(again.std(), fit_linear(W, y, NAMES, UNITS).std(), rtol=0.01)


def test_the_condition_number_is_that_of_numpy(rng):
    W, y, _ = problem(rng)
    fit = fit_linear(W, y, NAMES, UNITS)
    assert fit.condition == pytest.approx(np.linalg.cond(W))
    assert fit.scaled_condition == pytest.approx(np.linalg.cond(W / np.linalg.norm(W, axis=0)))


def test_relative_deviations_are_over_the_size_of_the_value(rng):
    # (7) as printed gives a negative deviation for the second, which is negative.
    W, y, _ = problem(rng)
    fit = fit_linear(W, y, NAMES, UNITS)
    np.testing.assert_allclose(fit.relative_std(), 100 * fit.std() / np.abs(fit.theta))
    assert (fit.relative_std() > 0).all()


def test_nuisance_taken_out_beforehand_leaves_the_estimates_of_the_whole(rng):
    # Closed form: the theorem of Frisch, Waugh and Lovell.
    W, y, _ = problem(rng)
    free = without_nuisance(np.column_stack([W[:, :2], y]), W[:, 2:])
    part = fit_linear(free[:, :2], free[:, 2], NAMES[:2], UNITS[:2])
    np.testing.assert_allclose(part.theta, fit_linear(W, y, NAMES, UNITS).theta[:2])


def test_a_value_comes_with_its_deviation(rng):
    W, y, _ = problem(rng)
    fit = fit_linear(W, y, NAMES, UNITS)
    assert fit.value("b") == (fit.theta[1], fit.std()[1])


def test_an_unknown_that_is_not_there_is_refused(rng):
    W, y, _ = problem(rng)
    with pytest.raises(ParameterError, match="The fit has no unknown 'd': its unknowns are a, b, c"):
        fit_linear(W, y, NAMES, UNITS).value("d")


def test_columns_that_depend_on_each_other_are_refused(rng):
    W, y, _ = problem(rng)
    W[:, 2] = W[:, 0] - 3 * W[:, 1]
    with pytest.raises(IdentifiabilityError, match="does not part the unknowns a, b, c"):
        fit_linear(W, y, NAMES, UNITS)


def test_a_column_of_zeros_is_refused(rng):
    W, y, _ = problem(rng)
    W[:, 2] = 0
    with pytest.raises(IdentifiabilityError, match="record a motion that excites each"):
        fit_linear(W, y, NAMES, UNITS)


def test_as_many_equations_as_unknowns_are_too_few(rng):
    W, y, _ = problem(rng, rows=3)
    with pytest.raises(IdentifiabilityError, match="3 equations are too few for 3 unknowns"):
        fit_linear(W, y, NAMES, UNITS)
