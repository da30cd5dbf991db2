"""Friction before slip: Dahl's law and presliding."""

from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.friction.presliding_friction import (
    PreslidingFriction,
    bristle,
    bristle_law,
    dahl,
    stick_law,
    strokes,
)
from phantom_dyn.effects.operation import Operation
from phantom_dyn.motion import Motion

EFFECT = PreslidingFriction()

STICKING = np.array([0.5, 0.01, 1.05, 0.3])  # torque, displacement, static ratio, stick velocity


def there_and_back(arm, speed: float, way: float, samples: int, turns: int = 3) -> Operation:
    """``tilt`` moves at constant speed over ``way`` and back, ``turns`` times, ``samples`` each."""
    q = np.concatenate([np.linspace(0, way, samples, endpoint=False), np.linspace(way, 0, samples, endpoint=False)])
    q = np.tile(q, turns)
    v = np.tile(np.repeat([speed, -speed], samples), turns)
    states = np.zeros((2, len(q), 3))
    states[0, :, 1], states[1, :, 1] = q, v
    t = np.arange(len(q)) * way / speed / samples
    return Operation.of(arm, Motion(t, states[0], states[1], np.zeros((len(q), 3))))


@pytest.mark.parametrize("displacement", [0.003, 0.05, 0.4, 3.0])
def test_the_bristle_follows_its_law_sample_by_sample(rng, displacement):
    # Contract and elasto-plastic law: z += dq, held within +-d.
    q = np.cumsum(rng.normal(size=700)) * 0.05
    z, expected = 0.0, [0.0]
    for step in np.diff(q):
        z = np.clip(z + step, -displacement, displacement)
        expected.append(z / displacement)
    np.testing.assert_allclose(bristle(q, displacement), expected, atol=1e-11)


def test_one_sample_has_no_deflection():
    np.testing.assert_array_equal(bristle(np.array([0.7]), 0.1), [0.0])


def test_a_loop_loses_the_area_of_its_hysteresis(arm):
    # Closed form: the loop is a parallelogram of height 2 T and width w - 2 d.
    operation = there_and_back(arm, 0.5, 0.4, 4000)
    torque = EFFECT.torque(arm, operation, "tilt", np.array([0.6, 0.05]))[:, 1]
    last = slice(2 * 4000, 4 * 4000 + 1)
    q, torque = operation.q[last, 1], torque[last]
    work = np.sum(0.5 * (torque[1:] + torque[:-1]) * np.diff(q))
    assert work == pytest.approx(-2 * 0.6 * (0.4 - 2 * 0.05), rel=1e-3)


def test_within_its_displacement_it_is_a_spring_of_torque_over_displacement(arm):
    operation = there_and_back(arm, 0.1, 0.04, 100)
    torque = EFFECT.torque(arm, operation, "tilt", np.array([0.6, 0.05]))[:, 1]
    np.testing.assert_allclose(torque, -0.6 / 0.05 * operation.q[:, 1], atol=1e-12)


def test_a_short_displacement_is_coulomb_friction(arm, smooth):
    coulomb = effect_named("coulomb_friction").torque(arm, smooth, "tilt", np.array([0.6]))[:, 1]
    torque = EFFECT.torque(arm, smooth, "tilt", np.array([0.6, 1e-9]))[:, 1]
    slip = np.abs(np.diff(smooth.q[:, 1], prepend=smooth.q[0, 1])) > 1e-6
    slip &= np.sign(np.diff(smooth.q[:, 1], prepend=smooth.q[0, 1])) == np.sign(smooth.v[:, 1])
    np.testing.assert_allclose(torque[slip], coulomb[slip])


def test_the_torque_does_not_depend_on_speed(arm):
    slow, fast = there_and_back(arm, 0.1, 0.4, 500), there_and_back(arm, 10.0, 0.4, 500)
    theta = np.array([0.6, 0.05])
    np.testing.assert_allclose(
        EFFECT.torque(arm, slow, "tilt", theta), EFFECT.torque(arm, fast, "tilt", theta), atol=1e-12
    )


def test_a_bristle_in_the_place_of_coulomb_friction_leaves_no_step(arm, smooth):
    # By definition: friction of the model and of the effect are together the bristle's alone.
    rubbing = replace(arm, coulomb_friction=np.array([0.0, 0.5, 0.0]))
    taken = EFFECT.torque(rubbing, smooth, "tilt", np.array([0.5, 0.02, -0.5]))[:, 1]
    alone = EFFECT.torque(rubbing, smooth, "tilt", np.array([0.5, 0.02]))[:, 1]
    np.testing.assert_allclose(taken - 0.5 * np.sign(smooth.v[:, 1]), alone, atol=1e-12)
    changed = EFFECT.simulated(rubbing, "tilt", np.array([0.5, 0.02, -0.5])).robot(rubbing)
    assert changed.coulomb_friction[1] == 0.0
    assert EFFECT.model_numbers(rubbing, "tilt", np.array([0.5, 0.02, -0.5])).coulomb == 0.0
    assert EFFECT.remark(rubbing, "tilt", np.array([0.5, 0.02, -0.4])) == (
        "Of the 0.5 N m of Coulomb friction that the model has on tilt, 0.4 N m do not "
        "set in at once: they are part of its presliding friction."
    )
    assert EFFECT.remark(rubbing, "tilt", np.array([0.5, 0.02, 0.0])) == ""


def test_it_takes_the_place_of_no_more_coulomb_friction_than_is_modelled(arm):
    rubbing = replace(arm, coulomb_friction=np.array([0.0, 0.7, 0.0]))
    assert EFFECT.coefficient_bounds(rubbing, "tilt", (0.02,))[1:] == ((-0.7, 0.0),)
    assert [one.lower for one in EFFECT.parameters(rubbing, "tilt")] == [0.0, 0.0, -0.7]
    assert [one.name for one in EFFECT.parameters(rubbing, "turn")] == ["torque", "displacement"]


def test_displacements_that_are_tried_follow_the_way_between_reversals(arm):
    # Known truth: every stroke is 0.4 rad long.
    operation = there_and_back(arm, 0.5, 0.4, 200)
    np.testing.assert_allclose(strokes(operation, 1), 0.4, rtol=0.01)
    shapes = EFFECT.shapes(arm, operation, "tilt")
    assert shapes[0][0] == pytest.approx(0.0016, rel=0.01)
    assert shapes[-1][0] == pytest.approx(0.16, rel=0.01)


def test_a_joint_that_never_reverses_cannot_show_it(arm):
    operation = there_and_back(arm, 0.5, 0.4, 200)
    forwards = Operation.of(arm, Motion(*(x[:200] for x in (operation.t, operation.q, operation.v, operation.a))))
    assert EFFECT.untestable(arm, forwards, "tilt") == (
        "tilt never reverses: its friction looks like a constant torque"
    )
    assert EFFECT.untestable(arm, operation, "tilt") is None


THETAS = [np.array([0.5, 0.02]), STICKING, np.array([0.5, 0.02, 0.0]), np.array([0.5, 0.02, 0.0, 1.05, 0.3])]


@pytest.mark.parametrize("theta", THETAS, ids=["bristle", "sticking", "no change", "sticking, no change"])
def test_a_simulation_gives_the_same_torque(arm, smooth, torque_in_steps, theta):
    expected = EFFECT.torque(arm, smooth, "tilt", theta)
    np.testing.assert_allclose(torque_in_steps(EFFECT.simulated(arm, "tilt", theta), smooth), expected, atol=1e-12)


@pytest.mark.parametrize("theta", [np.array([0.5, 0.02]), STICKING], ids=["bristle", "sticking"])
def test_half_the_samples_give_the_same_torque(arm, smooth, theta):
    # Time-step independence: away from reversals, where the turning point itself falls between samples.
    half = Operation.of(arm, Motion(*(x[::2] for x in (smooth.t, smooth.q, smooth.v, smooth.a))))
    whole = EFFECT.torque(arm, smooth, "tilt", theta)[::2, 1]
    error = np.abs(EFFECT.torque(arm, half, "tilt", theta)[:, 1] - whole)
    assert np.quantile(error, 0.9) < 0.05 * theta[0]


def test_a_stuck_joint_breaks_loose_at_the_static_ratio(arm):
    # Published value: seed model of haptic hardware, 1.05 times the slip friction.
    operation = there_and_back(arm, 0.01, 0.2, 4000, turns=1)
    torque = EFFECT.torque(arm, operation, "tilt", STICKING)[:, 1]
    assert np.abs(torque).max() == pytest.approx(1.05 * 0.5, rel=6e-3)


def test_above_the_stick_velocity_it_slips(arm):
    operation = there_and_back(arm, 0.5, 0.2, 400)
    torque = EFFECT.torque(arm, operation, "tilt", STICKING)[:, 1]
    np.testing.assert_array_equal(torque, -0.5 * np.sign(operation.v[:, 1]))


def test_on_sticking_the_torque_drops_to_almost_nothing(arm):
    # Published behaviour: the glitch at the change from slip to stick.
    operation = there_and_back(arm, 0.5, 0.2, 400, turns=1)
    v = operation.v.copy()
    v[400:, 1] = -0.2  # creeps back below the stick velocity
    creeping = Operation.of(arm, replace(Motion(operation.t, operation.q, v, operation.a)))
    torque = EFFECT.torque(arm, creeping, "tilt", STICKING)[:, 1]
    assert torque[399] == -0.5
    # The spring is attached to where the joint was the sample before.
    assert torque[400] == pytest.approx(-1.05 * 0.5 / 0.01 * (operation.q[400, 1] - operation.q[399, 1]))
    assert abs(torque[400]) < 0.1 * 0.5


def test_a_joint_at_rest_has_displacements_to_try_too(arm):
    still = Operation.of(arm, Motion(np.arange(9) / 100.0, *np.zeros((3, 9, 3))))
    assert min(displacement for (displacement,) in EFFECT.shapes(arm, still, "tilt")) > 0


@pytest.mark.parametrize(
    ("state", "q", "v", "after"),
    # By hand: 2 N m in slip, 3 N m to break loose, by a spring of 30 N m/rad; it sticks below 0.1 rad/s.
    [
        ((np.nan, 0.0, 0.0), 0.5, 0.05, (1.0, 0.5, 0.0)),
        ((0.48, 0.0, 0.0), 0.5, 0.05, (1.0, 0.48, -0.6)),
        ((0.48, 0.0, 0.0), 0.5, -0.05, (1.0, 0.48, -0.6)),
        ((0.48, 0.0, 0.3), 0.5, 0.1, (0.0, 0.3, -2.0)),
        ((0.48, 0.0, 0.3), 0.5, -0.2, (0.0, 0.3, 2.0)),
        ((0.48, 1.0, 0.52), 0.5, 0.05, (1.0, 0.52, 0.6)),
        ((0.48, 1.0, 0.45), 0.5, 0.7, (1.0, 0.45, -1.5)),
        ((0.48, 1.0, 0.401), 0.5, 0.05, (1.0, 0.401, -2.97)),
        ((0.48, 1.0, 0.375), 0.5, 0.05, (0.0, 0.375, -2.0)),
        ((0.48, 1.0, 0.625), 0.5, -0.05, (0.0, 0.625, 2.0)),
    ],
    ids=[
        "first",
        "sticks",
        "sticks back",
        "fast",
        "fast back",
        "held back",
        "held fast",
        "held",
        "loose",
        "loose back",
    ],
)
def test_a_joint_sticks_to_where_it_was_and_breaks_loose_at_the_static_torque(state, q, v, after):
    assert stick_law(*state, q, v, 2.0, 0.1, 1.5, 0.1) == pytest.approx(after)


def test_a_joint_without_displacement_sticks_by_a_stiff_spring():
    assert stick_law(0.5, 1.0, 0.5, 0.5, 0.0, 2.0, 0.0, 1.5, 0.1) == (1.0, 0.5, pytest.approx(0.0))
    assert stick_law(0.5, 1.0, 0.5, 0.5 + 1e-9, 0.0, 2.0, 0.0, 1.5, 0.1)[0] == 0.0


@pytest.mark.parametrize(
    ("last", "z", "q", "after"),
    # By hand: 2 N m at a deflection of 0.1 rad.
    [(np.nan, 0.07, 0.5, 0.0), (0.48, 0.01, 0.5, 0.03), (0.48, 0.09, 0.5, 0.1), (0.52, -0.095, 0.5, -0.1)],
)
def test_a_bristle_is_deflected_by_the_way_up_to_its_displacement(last, z, q, after):
    assert bristle_law(last, z, q, 2.0, 0.1) == pytest.approx((after, -20.0 * after))


def test_a_bristle_without_displacement_is_coulomb_friction():
    assert bristle_law(0.4, 0.0, 0.5, 2.0, 0.0)[1] == pytest.approx(-2.0)
    np.testing.assert_allclose(bristle(np.array([0.4, 0.5, 0.3]), 0.0), [0.0, 1.0, -1.0])


def test_displacements_of_a_hundred_times_are_tried_in_equal_ratios(arm):
    operation = there_and_back(arm, 0.5, 0.4, 200)
    tried = np.array([displacement for (displacement,) in EFFECT.shapes(arm, operation, "tilt")])
    assert len(tried) == 6
    np.testing.assert_allclose(tried[1:] / tried[:-1], 100.0 ** (1 / 5))


def test_strokes_are_the_ways_between_turning_points(arm):
    # By hand: 0.3 up, 0.5 down and 0.2 up again, the last one cut off.
    q = np.interp(np.arange(1001), [0, 300, 800, 1000], [0.0, 0.3, -0.2, 0.0])
    states = np.zeros((3, 1001, 3))
    states[0, :, 1], states[1, :, 1] = q, np.gradient(q)
    found = strokes(Operation.of(arm, Motion(np.arange(1001) / 100.0, *states)), 1)
    np.testing.assert_allclose(found, [0.3, 0.5, 0.2], atol=2e-3)


def test_a_bristle_of_dahl_yields_as_an_exponential_after_a_reversal():
    # Closed form: from -1 on the way back by x it gives 1 - 2 exp(-x / d).
    d, way = 0.02, np.linspace(0.0, 0.1, 200)
    q = np.concatenate([np.linspace(1.0, 0.0, 50), way[1:]])
    np.testing.assert_allclose(dahl(q, d)[49:], 1.0 - 2.0 * np.exp(-way / d), atol=1e-12)


def test_from_rest_the_slope_of_a_bristle_of_dahl_is_one_over_its_displacement():
    # The contract's initial stiffness: torque / displacement.
    q = np.array([0.3, 0.3 + 1e-7])
    assert np.isclose(dahl(q, 0.02)[1] / 1e-7, 1.0 / 0.02, rtol=1e-4)


def test_a_bristle_of_dahl_follows_its_differential_equation(rng):
    # Oracle: one exact step after the other.
    q, d = np.cumsum(rng.normal(0.0, 0.01, 100)), 0.02
    z = [0.0]
    for step in np.diff(q):
        z.append(np.sign(step) + (z[-1] - np.sign(step)) * np.exp(-abs(step) / d))
    np.testing.assert_allclose(dahl(q, d), z, atol=1e-12)
