from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import truncnorm

from identification.data.changes import KnownPayload, with_payload
from identification.diagnosis.columns.operations import adjusted_robot
from identification.diagnosis.columns.terms import FoundEffect
from identification.diagnosis.columns.tolerance_parameters import tolerance_parameters
from identification.diagnosis.fit.covariance import covariance, free_parameters
from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.fit.full_fit import full_fit, within_tolerances
from identification.diagnosis.fit.problem import set_up
from identification.diagnosis.fit.whole_model import lay_out, linearised
from identification.diagnosis.judge.findings.parameters import finding_parameters
from identification.diagnosis.judge.judged_band import plain_search
from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.friction.presliding_friction import dahl
from phantom_dyn.effects.support.changed_robot import with_parameters, with_rotor_inertia


def judged(lab, robot, motion, torque, near, *, seed=0):
    """A recording as the findings are stated from: in the judged band, with one effect near its shape."""
    found = (FoundEffect(effect_named(near[0]), near[1], near[2], np.array(near[3])),)
    prepared = lab.prepared(robot, (lab.recording(robot, motion, torque, seed=seed),), white=False, found=found)
    return prepared, plain_search(prepared.search, prepared.noise).problem


def fitted_with(robot, prepared, problem, *terms):
    return full_fit(problem, terms, fit(problem, terms, held_out=False))


@pytest.fixture(scope="module")
def slipping(lab, planar2):
    """Friction on the elbow that falls from 0.9 to 0.3 N m at 0.2 rad/s; the shapes tried are a fifth off."""
    motion = lab.motion(2, 4, seconds=20.0, swing=1.5)
    torque = lab.acting(planar2, motion, "stribeck_friction", "elbow", 0.3, 0.9, 0.2)
    return judged(lab, planar2, motion, torque, ("stribeck_friction", "elbow", (0.25,), [0.3, 0.6]))


def middle(prepared, place):
    terms = sorted((t for t in prepared.columns.terms if t.effect_joint == place), key=lambda t: t.shape)
    return terms[len(terms) // 2]


def test_a_shape_off_its_grid_is_found_with_its_coefficients(slipping, planar2):
    # Known truth: the grid has 0.21, 0.25 and 0.295 rad/s.
    prepared, problem = slipping
    term = middle(prepared, ("stribeck_friction", "elbow"))
    values = finding_parameters(planar2, term, fitted_with(planar2, prepared, problem, term))
    truth = {"coulomb_torque": 0.3, "static_torque": 0.9, "stribeck_velocity": 0.2}
    for name, known in truth.items():
        assert abs(values[name].value - known) < 3 * values[name].std
    assert 0 < values["stribeck_velocity"].std < 0.1 * 0.2


def test_a_joint_fit_trusts_each_sample_as_the_fit_before_it_does(slipping, planar2):
    # Oracle: the linear fit with the same trust; 2 N m in the second half of the recording, which hardly counts.
    prepared, problem = slipping
    term = middle(prepared, ("viscous_friction", "elbow"))
    late = np.arange(len(problem.white.residual[0]))[:, None] > 0.5 * len(problem.white.residual[0])
    trust = (np.where(late, 0.01, 1.0) * np.ones(2),)
    white = replace(problem.white, residual=(problem.white.residual[0] + np.where(late, 2.0, 0.0),))
    problem = set_up(problem.session, problem.columns, white, replace(problem.weights, trust=trust))
    fitted = fitted_with(planar2, prepared, problem, term)
    expected = fit(problem, (term,)).theta[list(term.columns)]
    np.testing.assert_allclose(fitted.x[fitted.slices_of(term).coefficients], expected, rtol=0.03)


def test_a_coefficient_is_known_less_well_when_its_shape_is_not(slipping, planar2):
    prepared, problem = slipping
    term = middle(prepared, ("stribeck_friction", "elbow"))
    fitted = fitted_with(planar2, prepared, problem, term)
    held = fit(problem, (term,))
    at = np.searchsorted(held.active, term.columns)
    own = fitted.slices_of(term).coefficients
    excess = own.stop - 1  # the kinetic torque is that of any shape
    assert fitted.cov[excess, excess] > held.cov[at[1], at[1]]
    assert fitted.cov[excess, fitted.slices_of(term).shape.start] < 0  # more excess, shorter reach


@pytest.mark.parametrize(
    ("place", "shape", "own"),
    [
        (("stribeck_friction", "elbow"), (0.25,), [0.3, 0.6]),
        (("input_delay", "elbow"), (0.004,), [0.004]),
        (("transmission_compliance", "elbow"), (2e-3, 0.1), [2e-3]),
        (("encoder_offset", "elbow"), (0.05,), [0.05]),
        (("encoder_eccentricity", "elbow"), (), [0.03, 0.02]),
        (("torque_constant", "elbow"), (), [0.1]),
        (("payload", None), (), [0.4, 0.0, 0.0, -0.1]),
    ],
)
def test_slopes_are_those_of_the_torque(lab, planar2, place, shape, own):
    # Oracle: central differences of the torque itself.
    near = (*place, shape, own if place[0] != "payload" else [*own, *[0.0] * 6])
    prepared, problem = judged(lab, planar2, lab.motion(2, 4, seconds=12.0), 0.0, near)
    terms = (middle(prepared, place), prepared.term("viscous_friction", "elbow"))
    start = fit(problem, terms, held_out=False)
    setting, x = lay_out(problem, terms, start)
    x[setting.term_slices[0].coefficients] = own
    slopes = linearised(setting, x).slopes[0]
    for k in range(problem.nuisance_count, setting.size):
        step = np.zeros(setting.size)
        step[k] = 1e-3 * max(abs(x[k]), 0.1 * float(np.abs(own).max()))
        above, below = (linearised(setting, x + sign * step).torque[0] for sign in (1.0, -1.0))
        expected = (above - below) / (2.0 * step[k])
        assert np.abs(slopes[:, :, k] - expected).max() <= 0.02 * np.abs(expected).max()


def test_a_tilted_base_turns_the_weights_of_the_true_robot(lab, planar2):
    # Known truth: masses are nearly two tolerances off, by which a tilt of the given model's would be wrong.
    parameters = tolerance_parameters(planar2)
    changes = np.where([parameter.name.endswith("mass") for parameter in parameters], 0.09, 0.0)
    true = adjusted_robot(planar2, changes)
    motion = lab.motion(2, 4, seconds=20.0, swing=1.5)
    torque = lab.acting(true, motion, "base_tilt", None, 0.0, 0.3, 0.0)
    less = inverse_dynamics(true, motion) - inverse_dynamics(planar2, motion)
    prepared, problem = judged(lab, planar2, motion, torque - less, ("base_tilt", None, (0.0, 0.3), [0.0, 0.3]))
    term = prepared.term("base_tilt", None)
    fitted = fitted_with(planar2, prepared, problem, term)
    pitch = finding_parameters(planar2, term, fitted)["pitch"]
    assert abs(pitch.value - 0.3) < 3 * pitch.std
    # In the columns of the search too: of the weights in the given gravity it was a tenth too large.
    linear = fit(problem, (term,), held_out=False).theta[term.columns[-1]]
    assert abs(linear - 0.3) < 0.01 * 0.3


def test_a_bristle_that_yields_by_another_law_is_within_the_interval(lab, planar2):
    # Known truth: a bristle of Dahl's, 0.5 N m over 0.02 rad; the law of the catalogue fits best with a fifth less.
    motion = lab.motion(2, 4, seconds=20.0)
    torque = np.zeros_like(motion.q)
    torque[:, 1] = -0.5 * dahl(motion.q[:, 1], 0.02)
    prepared, problem = judged(lab, planar2, motion, torque, ("presliding_friction", "elbow", (0.02,), [0.5, 0.0]))
    term = middle(prepared, ("presliding_friction", "elbow"))
    values = finding_parameters(planar2, term, fitted_with(planar2, prepared, problem, term))
    assert abs(values["torque"].value - 0.5) < 1.96 * values["torque"].std
    assert abs(values["displacement"].value - 0.02) < 1.96 * values["displacement"].std
    assert values["displacement"].value < 0.02


def test_a_gap_of_which_only_a_share_fits_is_known_no_better_than_the_share(lab, planar2):
    # Known truth: four fifths of what a gap leaves, which no gap does.
    motion = lab.motion(2, 4, seconds=12.0, swing=1.5)
    torque = 0.8 * lab.acting(planar2, motion, "backlash", "elbow", 0.02)
    prepared, problem = judged(lab, planar2, motion, torque, ("backlash", "elbow", (0.02,), [0.8]))
    term = middle(prepared, ("backlash", "elbow"))
    fitted = fitted_with(planar2, prepared, problem, term)
    share = fitted.x[fitted.slices_of(term).coefficients][0]
    gap = finding_parameters(planar2, term, fitted)["gap"]
    assert share < 0.95
    assert gap.std > (1.0 - share) * gap.value
    # Which law of a play it is says nothing on whether there is one.
    assert np.sqrt(fitted.presence_covariance(term)[-1, -1]) < (1.0 - share) * gap.value


@pytest.mark.whole
@pytest.mark.nightly
def test_an_interval_of_95_per_cent_holds_the_truth_about_as_often(lab, planar2):
    # Known truth over seeds of the noise: 3 numbers each. Less by chance: 1 in 500.
    motion = lab.motion(2, 4, seconds=12.0, swing=1.5)
    torque = lab.acting(planar2, motion, "stribeck_friction", "elbow", 0.3, 0.9, 0.2)
    truth, held = {"coulomb_torque": 0.3, "static_torque": 0.9, "stribeck_velocity": 0.2}, 0
    for seed in range(12):
        near = ("stribeck_friction", "elbow", (0.21,), [0.3, 0.6])
        prepared, problem = judged(lab, planar2, motion, torque, near, seed=seed)
        term = middle(prepared, ("stribeck_friction", "elbow"))
        values = finding_parameters(planar2, term, fitted_with(planar2, prepared, problem, term))
        held += sum(abs(values[name].value - known) < 1.96 * values[name].std for name, known in truth.items())
    assert held >= 30


def test_a_size_is_known_better_where_a_tolerance_ends():
    # Oracle: the truncated normal distribution. A size that is exchanged for a tolerance parameter, which is fitted to
    # 0.19 and ends at 0.2, is as far from its estimate as that parameter may be; what no such parameter touches stays.
    cov = np.array([[0.01, -0.01, 0.0], [-0.01, 0.01 + 1e-6, 0.0], [0.0, 0.0, 1.0]])
    x, end = np.array([0.19, 0.3, 5.0]), np.array([0.2, np.inf, np.inf])
    known = within_tolerances(x, cov, 1, -end, end)
    possible = truncnorm((-0.2 - 0.19) / 0.1, (0.2 - 0.19) / 0.1, scale=0.1).std()
    assert np.sqrt(known[1, 1]) == pytest.approx(possible, rel=0.1)
    assert np.diag(known)[[0, 2]] == pytest.approx([0.01, 1.0], rel=0.1)


def test_rounding_does_not_change_how_well_a_size_is_known():
    # Three sizes of one deviation, exchanged for one tolerance parameter: two directions have the same scatter, and
    # rounding decides what is taken for them.
    cov = np.diag([0.01, 1.0, 1.0, 1.0])
    cov[0, 1:] = cov[1:, 0] = -0.05
    x, end = np.array([0.19, 0.3, 5.0, 1.0]), np.array([0.2, np.inf, np.inf, np.inf])
    rounded = cov.copy()
    rounded[1, 2] = rounded[2, 1] = 1e-13
    one, other = (within_tolerances(x, given, 1, -end, end) for given in (cov, rounded))
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)


def test_the_pull_on_a_number_that_a_bound_holds_is_no_scatter():
    # A number that may not change does not, however hard the data of each block pull on it.
    rng = np.random.default_rng(0)
    design, noise = rng.standard_normal((8, 30, 3)), rng.standard_normal((8, 30))
    a, b = np.einsum("bnp,bnq->bpq", design, design), np.einsum("bnp,bn->bp", design, noise)
    bounds = np.array([-np.inf, -np.inf, -np.inf]), np.array([0.0, np.inf, np.inf])
    pulls = [np.abs(b[:, 0]), 1000.0 * np.abs(b[:, 0])]

    def known(pull):
        pulled = np.column_stack([pull, b[:, 1:]])
        free = free_parameters(pulled, np.zeros(3), np.zeros(3), bounds)
        return covariance(a, pulled, np.zeros(3), np.zeros(3), free, np.zeros((3, 3)))

    one, other = (known(pull) for pull in pulls)
    np.testing.assert_allclose(one, other)


def test_numbers_that_blocks_shift_against_each_other_have_a_certain_sum():
    # Closed form: two numbers in the same equations but for little, and errors that shift the blocks along their
    # difference. The sum has the deviation of the noise alone, the difference that of the blocks.
    rng = np.random.default_rng(0)
    sums, differences = rng.standard_normal((2, 12, 400, 1))
    design = sums * np.array([1.0, 1.0]) + 0.1 * differences * np.array([1.0, -1.0])
    off = 3.0 * rng.standard_normal((12, 1)) * 0.1 * differences[..., 0]
    a, b = np.einsum("bnp,bnq->bpq", design, design), np.einsum("bnp,bn->bp", design, off)
    given = (a, b, np.zeros(2), np.zeros(2), np.arange(2), np.zeros((2, 2)))
    of_sum, of_difference = np.array([1.0, 1.0]), np.array([1.0, -1.0])
    noise = np.linalg.inv(a.sum(axis=0))
    apart, together = covariance(*given), covariance(*given, (slice(0, 2),))
    assert of_sum @ apart @ of_sum > 10.0 * (of_sum @ noise @ of_sum)
    assert of_sum @ together @ of_sum == pytest.approx(of_sum @ noise @ of_sum, rel=0.3)
    assert of_difference @ together @ of_difference == pytest.approx(of_difference @ apart @ of_difference, rel=0.3)


def test_the_deviations_of_a_load_count_that_it_may_be_no_point(lab, planar2, trusted):
    planar2 = trusted(planar2)
    # Oracle: the same fit of a load of 1 kg that has a radius of gyration of 4 cm about its own centre.
    motion = lab.motion(2, 4, seconds=20.0, swing=1.5)
    load = KnownPayload(1.0, (0.05, 0.0, -0.3))
    ball = np.zeros_like(standard_parameters(planar2))
    ball[[14, 16, 19]] = load.mass * 0.04**2
    point = with_payload(planar2, load)
    fits = []
    for robot in (point, with_parameters(point, ball)):
        torque = inverse_dynamics(planar2, motion) - inverse_dynamics(robot, motion)
        prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque, noise=1e-3, seed=1),), white=False)
        term = next(t for t in prepared.columns.terms if t.effect_joint == ("payload", None))
        fits.append((fitted_with(planar2, prepared, prepared.problem, term), term))
    (of_point, own), (of_ball, other) = fits
    moved = np.abs(of_ball.coefficients(other) - of_point.coefficients(own))
    place = of_point.slices_of(own).coefficients
    deviations = np.sqrt(np.diag(of_point.cov)[place])
    assert moved[3] > 1e-4
    assert np.all(deviations[[0, 1, 3]] > 0.8 * moved[[0, 1, 3]])


@pytest.mark.parametrize(("rotor", "known"), [(0.0, False), (1e-3, True)])
def test_a_rotor_that_no_model_states_leaves_the_mass_on_a_pendulum_open(lab, pendulum, trusted, rotor, known):
    # By hand: the moment shows by its weight; the mass by an inertia, which a rotor of half of what is carried makes.
    robot = with_rotor_inertia(trusted(pendulum), "pin", rotor) if rotor else trusted(pendulum)
    motion = lab.motion(1, 4, seconds=20.0, swing=1.5)
    torque = lab.acting(robot, motion, "payload", None, 0.5, 0.0, 0.0, -0.5)
    prepared = lab.prepared(robot, (lab.recording(robot, motion, torque, noise=1e-3),), white=False)
    term = next(t for t in prepared.columns.terms if t.effect_joint == ("payload", None))
    fitted = fitted_with(robot, prepared, prepared.problem, term)
    mass, _, _, moment = np.sqrt(np.diag(fitted.cov)[fitted.slices_of(term).coefficients])
    assert moment < 0.1 * 0.25
    assert (mass < 0.5 / 8) == known
