"""Friction before slip: Dahl's law and presliding."""

from dataclasses import replace

import numpy as np
import pytest

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


def test_within_its_displacement_it_is_a_spring_of_torque_over_displacement(arm):
    operation = there_and_back(arm, 0.1, 0.04, 100)
    torque = EFFECT.torque(arm, operation, "tilt", np.array([0.6, 0.05]))[:, 1]
    np.testing.assert_allclose(torque, -0.6 / 0.05 * operation.q[:, 1], atol=1e-12)


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


def test_a_bristle_of_dahl_follows_its_differential_equation(rng):
    # Oracle: one exact step after the other.
    q, d = np.cumsum(rng.normal(0.0, 0.01, 100)), 0.02
    z = [0.0]
    for step in np.diff(q):
        z.append(np.sign(step) + (z[-1] - np.sign(step)) * np.exp(-abs(step) / d))
    np.testing.assert_allclose(dahl(q, d), z, atol=1e-12)
