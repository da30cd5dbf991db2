import numpy as np
import pytest

from phantom_dyn.effects.friction.position_dependent_friction import (
    PositionDependentFriction,
    bent_law,
    grid_positions,
    interpolation_weights,
)
from phantom_dyn.effects.operation import Operation
from phantom_dyn.motion import Motion
from tilt import recorded

EFFECT = PositionDependentFriction()
PLACES, TORQUES = np.array([-1.0, 0.0, 0.5]), np.array([0.2, 0.8, 0.4])
THETA = np.concatenate([PLACES, TORQUES])


def bump(operation: Operation) -> np.ndarray:
    return -np.exp(-(((operation.q[:, 1] - 0.5) / 0.6) ** 2)) * np.sign(operation.v[:, 1])


@pytest.mark.parametrize(("q", "level"), [(-3.0, 0.2), (-1.0, 0.2), (-0.5, 0.5), (0.0, 0.8), (0.25, 0.6), (2.0, 0.4)])
@pytest.mark.parametrize("v", [-0.7, 0.3])
def test_friction_is_linear_between_its_places_and_constant_beyond(arm, q, level, v):
    # By hand: 0.2 at -1, 0.8 at 0, 0.4 at 0.5.
    states = np.zeros((3, 2, 3))
    states[0, :, 1], states[1, :, 1] = q, v
    operation = Operation.of(arm, Motion(np.array([0.0, 0.1]), *states))
    torque = EFFECT.torque(arm, operation, "tilt", THETA)
    np.testing.assert_allclose(torque, [[0.0, -level * np.sign(v), 0.0]] * 2, atol=1e-15)


def test_weights_of_the_places_are_those_of_linear_interpolation():
    # By hand: between places each nearer one has the share of the way to the other; beyond, all is the end's.
    found = interpolation_weights(np.array([-2.0, -0.25, 0.0, 0.25, 9.0]), PLACES)
    np.testing.assert_allclose(found, [[1, 0, 0], [0.25, 0.75, 0], [0, 1, 0], [0, 0.5, 0.5], [0, 0, 1]])
    np.testing.assert_allclose(grid_positions((-1.0, 1.0, 5.0)), [-1.0, -0.5, 0.0, 0.5, 1.0])


def test_the_same_everywhere_it_is_coulomb_friction(arm, smooth):
    # Closed form: -T sign(v).
    torque = EFFECT.torque(arm, smooth, "tilt", np.array([-1.0, 0.0, 0.5, 0.6, 0.6, 0.6]))[:, 1]
    np.testing.assert_allclose(torque, -0.6 * np.sign(smooth.v[:, 1]), atol=1e-15)
    nothing, coulomb = EFFECT.special_cases(arm, "tilt", np.array([0.6, 0.6, 0.7]), (-1.0, 0.5, 3.0))
    assert (nothing.names, coulomb.names) == ((), ("coulomb_friction",))
    np.testing.assert_allclose(coulomb.numbers, [0.0, 0.1], atol=1e-15)


def test_with_what_is_modelled_it_is_nowhere_negative(arm):
    # By hand: the model of tilt has the Coulomb friction that its file states.
    least = -float(arm.coulomb_friction[1])
    assert least < 0.0
    assert EFFECT.coefficient_bounds(arm, "tilt", (-1.0, 1.0, 3.0)) == ((least, np.inf),) * 3


def test_a_bump_is_asked_for_among_noise(arm, wide, rng):
    # Known truth: a bump of twice the deviation of the noise, beside a wrong level and a wrong scale of the model.
    rest = -0.5 * np.sign(wide.v[:, 1]) - 0.02 * wide.tau[:, 1] + 0.5 * rng.normal(size=len(wide.t))
    shapes = EFFECT.shapes(arm, recorded(wide, bump(wide) + rest), "tilt")
    low, high = np.percentile(wide.q[:, 1], [3.0, 97.0])
    assert shapes == tuple((low, high, float(count)) for count in (5, 9, 14))


@pytest.mark.parametrize("beside", ["nothing", "coulomb", "load", "force over position"])
def test_what_is_no_friction_over_position_does_not_ask_for_it(arm, wide, rng, beside):
    # Known truth: noise, friction of one level, friction by load, and a force that is the same in both directions.
    s = np.sign(wide.v[:, 1])
    torque = {
        "nothing": 0.0 * s,
        "coulomb": -s,
        "load": -0.2 * np.abs(wide.transmitted[:, 1]) * s,
        "force over position": -bump(wide) * s,
    }[beside]
    assert EFFECT.shapes(arm, recorded(wide, torque + rng.normal(size=len(s))), "tilt") == ()


def test_what_another_finding_has_taken_is_asked_for_all_the_same(arm, wide):
    # Known truth: a fit with other friction has left nothing; what it made is in the torque that is expected.
    operation = recorded(wide, bump(wide))
    assert EFFECT.shapes(arm, operation.after_fit(operation.logged, np.zeros_like(operation.tau)), "tilt")


def test_a_joint_at_rest_or_in_one_direction_cannot_show_it(arm, wide):
    assert EFFECT.shapes(arm, wide, "turn") == ()
    forwards = Operation.of(arm, Motion(wide.t, wide.q, np.abs(wide.v) + 0.1, wide.a))
    assert EFFECT.untestable(arm, forwards, "tilt") == "tilt never reverses: its friction looks like a constant torque"
    assert EFFECT.untestable(arm, wide, "tilt") is None


def test_bends_are_the_same_law_on_scalars(arm, smooth):
    # Oracle: linear interpolation of NumPy. The level at the least place sticks, the rest is a sum of bends.
    simulated = EFFECT.simulated(arm, "tilt", THETA)
    for q in (-3.0, -0.5, 0.1, 0.4, 2.0):
        more = sum(law.function(q, -1.0, *law.numbers) for law in simulated.laws)
        assert more == pytest.approx(np.interp(q, PLACES, TORQUES - 0.2))
    assert {law.function for law in simulated.laws} == {bent_law}
    assert simulated.robot is not None
    assert simulated.robot(arm).coulomb_friction[1] == pytest.approx(arm.coulomb_friction[1] + 0.2)


def test_the_probe_is_a_torque_of_one_at_the_first_place(arm, wide):
    name, direction = EFFECT.probe(arm, wide, "tilt")
    assert name == "torque"
    theta = EFFECT.from_coefficients(arm, "tilt", np.concatenate([direction, np.zeros(2)]), (-1.0, 1.0, 3.0))
    np.testing.assert_allclose(theta, [-1.0, 0.0, 1.0, 1.0, 0.0, 0.0])
