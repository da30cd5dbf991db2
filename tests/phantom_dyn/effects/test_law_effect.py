"""Columns from a law alone, against analytic columns of the catalogue and closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import mass_matrix
from phantom_dyn.effects.author import LawEffect, Parameter, row_of, torque_on_joint
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.law_effect import unit_of
from phantom_dyn.effects.support.changed_robot import with_gravity
from phantom_dyn.errors import EffectError
from phantom_dyn.simulation.simulate import Cause, simulate


class OfCatalogue(LawEffect):
    """The law and the parameters of an effect of the catalogue, and nothing else of it."""

    def __init__(self, name, tried=()):
        self.inner, self.name, self.tried = effect_named(name), f"{name}_again", tried

    def parameters(self, robot, joint):
        known = self.inner.parameters(robot, joint)
        return (*known[:-1], replace(known[-1], tried=self.tried))

    def torque(self, robot, operation, joint, theta):
        return self.inner.torque(robot, operation, joint, theta)


class Hardening(LawEffect):
    """A spring whose torque grows with a power: ``-k q |q / w|``, with a size and a width."""

    name = "hardening_spring"

    def parameters(self, robot, joint):
        return Parameter("width", "rad", 0.1, 5.0, tried=(0.5, 2.0)), Parameter("stiffness", "N m/rad", 0.0, 0.25)

    def torque(self, robot, operation, joint, theta):
        q = operation.q[:, row_of(robot, joint)]
        return torque_on_joint(robot, joint, -theta[1] * q * np.abs(q / theta[0]))


@pytest.mark.parametrize(
    "name", ["viscous_friction", "coulomb_friction", "direction_dependent_friction", "torque_offset", "rotor_inertia"]
)
def test_columns_are_the_analytic_ones_where_the_law_is_linear(arm, operation, name):
    # Oracle: the analytic signature of the same effect; a difference of a linear law is exact.
    law, joint = OfCatalogue(name), "tilt"
    wanted = law.inner.signature(arm, operation, joint, ())
    made = law.signature(arm, operation, joint, ())
    np.testing.assert_allclose(made.columns, wanted.columns, rtol=1e-12, atol=1e-12)
    assert (made.rows, made.names, made.units) == (wanted.rows, wanted.names, wanted.units)


def test_columns_at_a_shape_span_the_analytic_ones(arm, operation):
    # Oracle: Stribeck friction, whose author has other coefficients (level and excess) of the same law.
    law, at = OfCatalogue("stribeck_friction", tried=(0.3, 1.0)), (0.3,)
    theirs = law.inner.signature(arm, operation, "tilt", at).columns[:, 0]
    mine = law.signature(arm, operation, "tilt", at).columns[:, 0]
    assert law.shapes(arm, operation, "tilt") == ((0.3,), (1.0,))
    coefficients = np.linalg.lstsq(mine, theirs, rcond=None)[0]
    np.testing.assert_allclose(mine @ coefficients, theirs, atol=1e-12)


def test_columns_times_coefficients_are_minus_the_torque_in_any_order_of_parameters(arm, operation):
    # Closed form: the contract's sign, with a shape that stands before the coefficient.
    law = Hardening()
    made = law.signature(arm, operation, "tilt", (0.7,))
    theta = law.from_coefficients(arm, "tilt", np.array([3.0]), (0.7,))
    assert theta.tolist() == [0.7, 3.0]
    torque = law.torque(arm, operation, "tilt", theta)
    np.testing.assert_allclose(made.columns[:, 0] @ [3.0], -torque[:, row_of(arm, "tilt")], rtol=1e-12)
    assert (made.names, made.units) == (("stiffness",), ("N m/rad",))


def test_neighbours_of_a_shape_are_a_sixth_apart_and_keep_it_in_the_middle():
    near = Hardening().refined(np.ones(1), (2.0, 3.0))
    assert near == ((1.7, 3.0), (2.0, pytest.approx(2.55)), (2.0, 3.0), (2.36, 3.0), (2.0, pytest.approx(3.54)))
    assert Hardening().at_estimate(np.ones(1), (2.0, 3.0)) == (2.0, 3.0)


def test_bounds_and_probe_are_those_of_the_linear_parameters(arm, operation):
    law = Hardening()
    assert law.coefficient_bounds(arm, "tilt", (0.7,)) == ((0.0, 0.25),)
    name, direction = law.probe(arm, operation, "tilt")
    assert (name, direction.tolist()) == ("stiffness", [1.0])


@pytest.mark.parametrize(
    ("lower", "upper", "size"), [(0.0, np.inf, 1.0), (0.0, 0.5, 0.5), (3.0, 9.0, 3.0), (-np.inf, 0.0, -1.0)]
)
def test_a_law_is_asked_where_its_parameter_may_be(lower, upper, size):
    assert unit_of(Parameter("x", "1", lower, upper)) == size


def test_a_simulation_steps_through_the_law(pendulum):
    # Closed form of I dv/dt = -T while it moves: v = v0 - T t / I.
    free = replace(with_gravity(pendulum, np.zeros(3)), viscous_friction=np.zeros(1), coulomb_friction=np.zeros(1))
    inertia, t = mass_matrix(free, np.zeros((1, 1)))[0, 0, 0], np.linspace(0.0, 2.0, 201)
    cause = Cause(OfCatalogue("coulomb_friction"), "pin", np.array([0.1]))
    moved = simulate(free, (cause,), lambda t, q, v: np.zeros(1), t, np.zeros(1), np.full(1, 3.0))
    np.testing.assert_allclose(moved.links.v[:, 0], 3.0 - 0.1 * t / inertia, rtol=1e-6)


def test_a_law_that_is_not_finite_on_a_recording_is_refused_by_name(arm, operation):
    class Pole(Hardening):
        def torque(self, robot, operation, joint, theta):
            return super().torque(robot, operation, joint, theta) / (operation.t - operation.t[3])[:, None]

    with (
        np.errstate(all="ignore"),
        pytest.raises(EffectError, match="law of hardening_spring is not finite on the motion of tilt: give a torque"),
    ):
        Pole().signature(arm, operation, "tilt", (1.0,))


def test_words_come_from_the_name():
    assert Hardening.words.name == "hardening spring"
    assert Hardening.words.next_step.startswith("Look for what causes hardening spring")
