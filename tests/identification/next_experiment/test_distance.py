"""Distance between rivals and motions that separate them."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.result import EffectAt
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
from identification.next_experiment.trials import followed
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Controller, Robot
from phantom_dyn.motion import Motion


def model(
    columns: tuple[int, ...], theta: list[float], moves: int = 1, sigma: float = 0.05, far: float = 100.0
) -> Model:
    """A fitted model of one move within a tolerance and the given columns of all."""
    used = [*range(moves), *columns]
    basis = np.eye(len(theta))[:, used]
    prior = np.where(np.arange(len(used)) < moves, 1.0 / sigma**2, 1e-6)
    full = np.array(theta)
    kept = np.where(np.isin(np.arange(len(theta)), used), full, 0.0)
    bound = np.where(np.arange(len(used)) < moves, far * sigma, np.inf)
    return Model(kept, basis, np.zeros(len(theta)), prior, -bound, bound, np.arange(len(used)) < moves, 0.0, columns)


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


def test_moves_that_the_truth_has_made_cost_nothing_more():
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
    """A fit of some columns of all, without moves of the model."""
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
    motion = followed(slide, reference(), share)
    mass = slide.model.inertias[1].mass + float(slide.model.armature[0])
    gain = share * KP / (share * KP - mass * W**2 + 1j * W * share * KD)
    wanted = 0.05 * (gain * np.exp(1j * W * motion.t)).real
    late = motion.t > 4.0
    np.testing.assert_allclose(motion.q[late, 0], wanted[late], atol=2e-4 * 0.05)


def test_a_robot_that_states_no_controllers_has_no_softer_ones(slide):
    silent = tuple(replace(drive, controller=None) for drive in slide.actuators)
    assert followed(replace(slide, actuators=silent), reference(), 0.5) is None


def test_a_loop_that_runs_away_gives_no_motion(slide):
    wild = tuple(replace(drive, controller=Controller(kp=KP, kd=-1e6)) for drive in slide.actuators)
    assert followed(replace(slide, actuators=wild), reference(), 1.0) is None
