"""Distance between rivals and motions that separate them.

Candidate motions that are safe.
"""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.log import Log
from identification.data.signals import low_pass
from identification.diagnosis.explanation import Explanation
from identification.diagnosis.noise.noise_floor import estimate_noise
from identification.diagnosis.result import EffectAt, Finding, Rival
from identification.excitation.closable import CLEAR
from identification.next_experiment.advise import proposed, simulated_tracking
from identification.next_experiment.candidates import SmallReversals, candidates, design_of, exciting, safe_limits
from identification.next_experiment.hypotheses import Hypothesis, Model
from identification.next_experiment.separation import (
    Pair,
    Rivalry,
    distance,
    draws_of,
    power_of,
    power_of_hopeless,
    power_of_simpler,
    separation,
)
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import ParameterError
from phantom_dyn.loops.solver import distance_from_singularity
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Controller, Robot
from phantom_dyn.motion import Motion
from places import ROBOTS


def model(
    columns: tuple[int, ...], theta: list[float], nuisances: int = 1, sigma: float = 0.05, far: float = 100.0
) -> Model:
    """A fitted model of one move within a tolerance and the given columns of all."""
    used = [*range(nuisances), *columns]
    basis = np.eye(len(theta))[:, used]
    prior = np.where(np.arange(len(used)) < nuisances, 1.0 / sigma**2, 1e-6)
    full = np.array(theta)
    kept = np.where(np.isin(np.arange(len(theta)), used), full, 0.0)
    bound = np.where(np.arange(len(used)) < nuisances, far * sigma, np.inf)
    return Model(
        kept, basis, np.zeros(len(theta)), prior, -bound, bound, np.arange(len(used)) < nuisances, 0.0, columns
    )


def test_a_model_that_can_make_the_truth_is_at_no_distance():
    truth = np.array([[0.02, 0.7, 0.0]])
    assert distance(truth, 1, model((1,), [0.0, 0.1, 0.0]), np.diag([10.0, 20.0, 30.0])) == pytest.approx(0, abs=1e-5)


def test_a_model_without_any_part_of_the_truth_leaves_all_of_its_torque():
    # Closed form: orthogonal columns, squared torque 20 * 0.7^2.
    truth = np.array([[0.0, 0.7, 0.0]])
    left = distance(truth, 1, model((2,), [0.0, 0.0, 0.1]), np.diag([10.0, 20.0, 30.0]))
    assert left == pytest.approx(20 * 0.7**2, rel=1e-6)


@pytest.mark.parametrize("sigma", [0.0125, 0.05, 0.4])
def test_what_a_tolerance_can_mimic_does_not_count(sigma):
    # Closed form: a move with the very column of the truth x pays (y / sigma)^2 and leaves a (x - y)^2.
    products = np.array([[20.0, 20.0, 0.0], [20.0, 20.0, 0.0], [0.0, 0.0, 30.0]])
    truth = np.array([[0.0, 0.7, 0.0]])
    left = distance(truth, 1, model((2,), [0.0, 0.0, 0.1], sigma=sigma), products)
    assert left == pytest.approx(20 * 0.7**2 / (1 + 20 * sigma**2), rel=1e-6)


def test_a_tolerance_mimics_no_more_than_its_bounds_let_it():
    # Closed form: the move stops at one sigma, and pays for it.
    products = np.array([[20.0, 20.0, 0.0], [20.0, 20.0, 0.0], [0.0, 0.0, 30.0]])
    left = distance(np.array([[0.0, 0.7, 0.0]]), 1, model((2,), [0.0, 0.0, 0.1], sigma=0.3, far=1.0), products)
    assert left == pytest.approx(20 * (0.7 - 0.3) ** 2 + 1.0**2, rel=1e-6)


def test_changes_that_the_truth_has_made_cost_nothing_more():
    truth = np.array([[0.05, 0.7, 0.0]])
    same = model((1,), [0.05, 0.7, 0.0])
    assert distance(truth, 1, same, np.diag([1e7, 20.0, 30.0])) == pytest.approx(0.0, abs=1e-4)


def test_the_power_is_that_of_losses_drawn_at_random(rng):
    # Oracle: wins of the wrong model over bootstrap replicates of sixty blocks, for torque with unit noise.
    torque = np.full(60, 0.6)
    noise = rng.standard_normal((2000, 60))
    gains = (torque + noise) ** 2 - noise**2
    counts = rng.multinomial(60, np.full(60, 1 / 60), size=400)
    struck = (gains @ counts.T - 4.0 < 0.0).mean(axis=1) < 0.05
    expected = power_of(np.array([torque @ torque]), head_start=-4.0, before=np.zeros(1))
    assert expected[0] == pytest.approx(np.mean(struck), abs=0.04)


def test_what_the_replicates_of_the_first_recording_scatter_makes_a_rival_harder_to_strike_off():
    alone, beside = (power_of(np.full(1, 30.0), 0.0, np.full(1, before)) for before in (0.0, 30.0))
    assert beside < alone - 0.1


@pytest.mark.parametrize("torque", [1.0, 1.3, 1.6])
def test_a_law_that_fits_badly_is_given_up_as_often_as_losses_drawn_at_random_say(rng, torque):
    # Oracle: losses by block of sixty blocks with unit noise, and the rule of the search for what is hopeless.
    noise = rng.standard_normal((4000, 60))
    worse = (torque + noise) ** 2 - noise**2
    given_up = worse.sum(axis=1) > 4.0 * np.sqrt(60) * worse.std(axis=1) + 4.0
    gain = np.full(1, 60 * torque**2)
    assert power_of_hopeless(gain, 0.0, gain)[0] == pytest.approx(np.mean(given_up), abs=0.06)


def test_without_a_difference_nothing_is_claimed():
    assert power_of(np.zeros(1), -0.1, np.zeros(1)) == pytest.approx(0.0)


def test_draws_scatter_as_the_recordings_leave_it_open(rng):
    # Closed form: the inverse of the products, the prior of the move and the size that is expected.
    products = np.diag([0.0, 100.0, 1.0])
    one = model((1, 2), [0.0, 0.5, 0.0])
    drawn = draws_of(one, products, rng.standard_normal((4000, 3)))[1:]
    energy = 100.0 * 0.5**2
    size = 1.0 / (0.25 * energy)
    np.testing.assert_allclose(drawn.std(axis=0), [0.05, (100 + 100 * size) ** -0.5, (1 + size) ** -0.5], rtol=0.05)
    np.testing.assert_allclose(drawn.mean(axis=0), one.theta, atol=0.05)


def test_a_richer_law_is_struck_off_only_where_its_further_part_would_have_shown():
    simple, rich = model((1,), [0.0, 2.0, 0.0, 0.0]), model((2, 3), [0.0, 0.0, 2.0, 0.1])
    recorded = np.diag([1.0, 400.0, 400.0, 1.0])
    shown = [power_of_simpler(simple, rich, factor * recorded, recorded) for factor in (1.0, 1e2, 1e6)]
    assert shown == sorted(shown)
    assert shown[-1] > 0.95


class Simple(Hypothesis):
    """Contains nothing."""

    def contains(self, other):
        return False


class Rich(Hypothesis):
    """Contains the other one."""

    def contains(self, other):
        return True


def law(columns: tuple[int, ...], theta: list[float]) -> Model:
    """A fit of some columns of all, without tolerance parameters."""
    basis = np.eye(len(theta))[:, list(columns)]
    bound = np.full(len(columns), np.inf)
    return Model(
        np.array(theta), basis, np.zeros(len(theta)), np.full(len(columns), 1e-6), -bound, bound,
        np.zeros(len(columns), dtype=bool), 0.0, columns,
    )  # fmt: skip


def test_a_richer_law_is_struck_off_no_more_surely_than_its_least_visible_shape(rng):
    # The simple law's column, one of a shape that differs from it, and one of a shape that hardly does. The simple law
    # is nearly certain, so that the power is that of striking off the other.
    simple, seen, hidden = (law((k,), theta) for k, theta in enumerate(2.0 * np.eye(3)))
    one = Simple((EffectAt("coulomb_friction", "pin"),), 1.0, ())
    other = Rich((EffectAt("presliding_friction", "pin"),), 0.0, ())

    def power(*shapes):
        same, own = rng.standard_normal((2, 4000))
        columns = np.stack([same, own, same + 0.001 * own], axis=1)
        rivalry = Rivalry(
            (Pair(one, other),), {one.effects: (simple,), other.effects: shapes}, columns.T @ columns, 1.0, 0
        )
        return separation(rivalry, 100.0 * columns.T @ columns).power[0]

    assert power(seen) > 0.9
    assert power(hidden) < 0.05
    assert power(seen, hidden) < 0.05


KP, KD, W = 40000.0, 4000.0, 2 * np.pi * 3.0


@pytest.fixture(scope="module")
def slide() -> Robot:
    """95 kg without friction, led by a controller of position."""
    slide = load_robot("emps")
    free = tuple(replace(drive, controller=Controller(kp=KP, kd=KD)) for drive in slide.actuators)
    return replace(slide, actuators=free)


def reference() -> Motion:
    """Six seconds of a sine that begins at a turn."""
    t = np.arange(3001) / 500.0
    q = 0.05 * np.cos(W * t)[:, None]
    return Motion(t, q, -0.05 * W * np.sin(W * t)[:, None], -(W**2) * q)


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_the_motion_is_that_of_the_linear_loop(slide, share):
    # Closed form: kp / (kp - M w^2 + i w kd), once the start has died away.
    motion = simulated_tracking(slide, reference(), share)
    mass = slide.model.inertias[1].mass + float(slide.model.armature[0])
    gain = share * KP / (share * KP - mass * W**2 + 1j * W * share * KD)
    wanted = 0.05 * (gain * np.exp(1j * W * motion.t)).real
    late = motion.t > 4.0
    np.testing.assert_allclose(motion.q[late, 0], wanted[late], atol=2e-4 * 0.05)


def test_a_robot_that_states_no_controllers_has_no_softer_ones(slide):
    silent = tuple(replace(drive, controller=None) for drive in slide.actuators)
    assert simulated_tracking(replace(slide, actuators=silent), reference(), 0.5) is None


def test_a_loop_that_runs_away_gives_no_motion(slide):
    wild = tuple(replace(drive, controller=Controller(kp=KP, kd=-1e6)) for drive in slide.actuators)
    assert simulated_tracking(replace(slide, actuators=wild), reference(), 1.0) is None


KINDS = {"Fourier series", "triangles and sines", "slow triangles", "holds with small reversals"}


def swinging(robot: Robot, reach: float = 0.5) -> Log:
    """Every joint swings as a sine of 0.5 Hz about zero."""
    t, w = np.arange(2000) / 200.0, np.pi * np.ones(robot.nv)
    angle = t[:, None] * w
    motion = Motion(t, reach * np.sin(angle), reach * w * np.cos(angle), -reach * w**2 * np.sin(angle))
    tau = inverse_dynamics(robot, motion)
    return Log("swing.csv", robot.joint_names, motion, tau, low_pass(20.0, 200.0), np.ones(len(t), dtype=bool))


@pytest.fixture(scope="module")
def arm() -> Robot:
    return load_robot(ROBOTS / "planar2.urdf")


def test_limits_are_not_much_wider_than_what_was_recorded(arm):
    # Closed form: half of the range beyond either end, and twice the speed.
    limits = safe_limits(arm, (swinging(arm, 0.5),))
    np.testing.assert_allclose(limits.upper, 1.0, rtol=1e-3)
    np.testing.assert_allclose(limits.lower, -1.0, rtol=1e-3)
    np.testing.assert_allclose(limits.velocity, 2.0 * 0.5 * np.pi, rtol=1e-3)


def test_a_stated_torque_limit_that_is_lower_is_kept(arm):
    from dataclasses import replace

    weak = replace(arm, actuators=tuple(replace(drive, torque_limit=0.9) for drive in arm.actuators))
    np.testing.assert_array_equal(safe_limits(weak, (swinging(arm),)).torque, 0.9)


def test_every_candidate_keeps_position_speed_and_torque_between_its_samples_too(arm, rng):
    # Oracle: inverse dynamics of the motion at ten times the rate it was designed at.
    limits = safe_limits(arm, (swinging(arm),))
    drawn = candidates(design_of(arm, limits), duration=8.0, count=16, rng=rng)
    assert {one.kind for one in drawn} == KINDS
    for one in (*drawn, exciting(design_of(arm, limits), 8.0, rng)):
        motion = one.motion(500.0)
        assert (motion.q < limits.upper + 0.01).all()
        assert (motion.q > limits.lower - 0.01).all()
        assert (np.abs(motion.v) < 1.02 * limits.velocity).all()
        assert (np.abs(inverse_dynamics(arm, motion)) < 1.05 * limits.torque).all()
        np.testing.assert_allclose(motion.v[[0, -1]], 0.0, atol=1e-9)


def test_the_exciting_motion_tells_more_of_the_inertial_parameters_than_any_random_one(arm, rng):
    # Oracle: the volume of their uncertainty, from the regressor of each motion.
    limits = safe_limits(arm, (swinging(arm),))
    problem = design_of(arm, limits)

    def said(one):
        return np.linalg.slogdet(problem.information(problem.regressor(one.motion(100.0))))[1]

    best = exciting(problem, 8.0, rng)
    assert said(best) > max(said(one) for one in candidates(problem, duration=8.0, count=16, rng=rng))


def test_the_same_seed_draws_the_same_motions(arm):
    limits = safe_limits(arm, (swinging(arm),))
    one, other = (
        candidates(design_of(arm, limits), duration=8.0, count=2, rng=np.random.default_rng(1)) for _ in range(2)
    )
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.weights, b.weights)


@pytest.fixture(scope="module")
def five_bar() -> Robot:
    return load_robot(ROBOTS / "fivebar.xml")


def swinging_chain(robot: Robot, reach: float) -> Log:
    """Both arms swing as sines of 0.5 and 0.4 Hz about the start."""
    t, w = np.arange(2000) / 200.0, np.pi * np.array([1.0, 0.8])
    angle = t[:, None] * w
    motion = Motion(t, reach * np.sin(angle), reach * w * np.cos(angle), -reach * w**2 * np.sin(angle))
    tau = inverse_dynamics(robot, motion)
    return Log("swing.csv", robot.joint_names, motion, tau, low_pass(20.0, 200.0), np.ones(len(t), dtype=bool))


def distances(robot: Robot, motion: Motion) -> np.ndarray:
    return distance_from_singularity(robot.solutions.at(motion.q).inverse)


@pytest.mark.nightly
@pytest.mark.whole
def test_every_candidate_closes_the_loop_and_stays_clear_of_a_singularity(five_bar, rng):
    limits = safe_limits(five_bar, (swinging_chain(five_bar, 0.8),))
    problem = design_of(five_bar, limits)
    drawn = candidates(problem, duration=8.0, count=8, rng=rng)
    assert len(drawn) == 8
    for one in (*drawn, exciting(problem, 8.0, rng)):
        motion = one.motion(300.0)
        assert distances(five_bar, motion).min() > limits.clear - 0.01
        assert (np.abs(inverse_dynamics(five_bar, motion)) < 1.05 * limits.torque).all()


def test_a_robot_that_was_recorded_nearer_to_a_singularity_may_go_there_again(five_bar):
    near = swinging_chain(five_bar, 0.1)
    q = near.motion.q * [11.0, -11.0]
    near = Log("near.csv", near.joint_names, Motion(near.motion.t, q, 0 * q, 0 * q), near.tau, near.band, near.valid)
    found = float(distances(five_bar, near.motion).min())
    assert 0.02 < found < CLEAR - 0.02
    assert safe_limits(five_bar, (near,)).clear == pytest.approx(found)
    assert safe_limits(five_bar, (swinging_chain(five_bar, 0.3),)).clear == CLEAR


@pytest.mark.whole
def test_friction_of_a_passive_joint_is_separated_from_that_of_a_drive(lab, five_bar):
    motion = lab.motion(2, 3, swing=0.3)
    torque = lab.acting(five_bar, motion, "coulomb_friction", "left_elbow", 0.02)
    ready = lab.prepared(five_bar, (lab.recording(five_bar, motion, torque, noise=0.02),))
    noise = estimate_noise(ready.session, ready.columns)[0]
    chosen = frozenset([ready.term("coulomb_friction", "left_elbow")])
    rivals = (Rival((EffectAt("coulomb_friction", "left"),), 0.3),)
    finding = Finding("coulomb_friction", "left_elbow", "everywhere", {}, 0.8, (0.7, 0.9), 0.7, rivals, "one_of")
    found = proposed(Explanation(ready.search, chosen, noise), (finding,))
    assert found.experiment is not None
    assert found.experiment["separates"] == [["coulomb_friction", "left_elbow"], ["coulomb_friction", "left"]]
    assert distances(five_bar, found.motion).min() > CLEAR - 0.01


FAMILY = SmallReversals(9.0, stops=3, reversals=4)


def test_every_shape_begins_and_ends_at_rest():
    np.testing.assert_allclose(FAMILY.values(np.array([0.0, 9.0]))[1:], 0.0, atol=1e-12)


def test_velocity_and_acceleration_are_the_slopes():
    # Oracle: central differences.
    t, h = np.linspace(0.01, 8.99, 901), 1e-6
    before, at, after = (FAMILY.values(t + step) for step in (-h, 0.0, h))
    np.testing.assert_allclose(at[1], (after[0] - before[0]) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(at[2], (after[1] - before[1]) / (2 * h), atol=1e-4)


def test_every_stop_is_held_with_reversals_of_the_size_that_was_asked_for():
    # Closed form: a triangle of unit amplitude about each posture, the slow one on the second joint.
    postures = np.array([[0.0, 1.0], [0.5, -1.0], [-0.3, 0.2]])
    weights = FAMILY.weights(postures, np.full((3, 2), 0.05), np.array([False, True]))
    t = np.linspace(0.0, 9.0, 4501)
    q = FAMILY.values(t)[0] @ weights
    for k, posture in enumerate(postures):
        here = q[(t > 3.0 * k + 1.4) & (t < 3.0 * k + 2.6)]
        np.testing.assert_allclose(here.max(axis=0) - posture, 0.05, rtol=0.03)
        np.testing.assert_allclose(posture - here.min(axis=0), 0.05, rtol=0.03)


def test_the_slower_triangle_turns_half_as_often():
    t = np.linspace(0.0, 3.0, 3001)
    v = SmallReversals(3.0, stops=1, reversals=6).values(t)[1]
    quick, slow = (np.sum(np.diff(np.sign(column[(t > 0.9) & (t < 3.0)])) != 0) for column in v[:, 1:3].T)
    assert quick == pytest.approx(2 * slow, abs=2)


@pytest.mark.parametrize("duration", [0.0, np.nan, -1.0])
def test_a_motion_without_a_length_is_refused(duration):
    with pytest.raises(ParameterError, match=r"The duration of the motion is .*: give a number above 0"):
        SmallReversals(duration)


def test_a_motion_without_reversals_is_refused():
    with pytest.raises(ParameterError, match="4 postures with 1 reversals were asked for: give at least 1 with 2"):
        SmallReversals(5.0, reversals=1)


def test_the_farthest_posture_is_reached_at_the_largest_speed_or_acceleration():
    # Oracle: the shapes themselves, along the way alone.
    farthest = FAMILY.farthest(np.array([1.3, 100.0]), np.array([1e6, 7.0]))
    weights = FAMILY.weights(np.outer([0.0, 1.0, 1.0], farthest), np.zeros((3, 2)), np.array([False, True]))
    values = FAMILY.values(np.linspace(0.0, FAMILY.duration, 100001)) @ weights
    assert np.abs(values[1]).max(axis=0)[0] == pytest.approx(1.3, rel=1e-4)
    assert np.abs(values[2]).max(axis=0)[1] == pytest.approx(7.0, rel=1e-3)
