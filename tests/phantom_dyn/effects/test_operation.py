"""What effects read of a recording: torque of the model, residual, time step, partial derivatives."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.dynamics.dynamics import link_torque
from phantom_dyn.effects.operation import Operation
from phantom_dyn.motion import Motion


@pytest.fixture
def moving(planar, rng) -> Operation:
    """Fifty states of two links with rotors and friction, at 20 Hz from half a second on."""
    return Operation.of(planar, Motion(0.5 + np.arange(50) / 20.0, *rng.uniform(-1, 1, (3, 50, 2))))


def test_the_time_step_is_the_mean_one(planar, moving):
    assert moving.dt == pytest.approx(0.05)
    one = Operation.of(planar, Motion(*(x[:1] for x in (moving.t, moving.q, moving.v, moving.a))))
    assert one.dt == 0.0


def test_transmissions_pass_what_the_links_take(planar, moving):
    np.testing.assert_allclose(moving.transmitted, link_torque(planar, moving), atol=1e-12)
    v = moving.v
    friction = planar.viscous_friction * v + planar.coulomb_friction * np.sign(v)
    np.testing.assert_allclose(moving.own_friction, friction, atol=1e-12)


def test_the_residual_is_that_of_the_model_until_a_fit_leaves_another(planar, moving):
    recorded = Operation.of(planar, moving, moving.tau + 3.0)
    np.testing.assert_allclose(recorded.residual, 3.0)
    np.testing.assert_array_equal(recorded.after_fit(recorded.tau, 0.1 * recorded.q).residual, 0.1 * recorded.q)


def test_another_fit_keeps_what_is_known_of_the_motion(moving):
    known = moving.transmitted, moving.inertia, moving.own_friction
    again = moving.after_fit(2.0 * moving.expected)
    assert all(
        one is other for one, other in zip((again.transmitted, again.inertia, again.own_friction), known, strict=True)
    )
    np.testing.assert_array_equal(again.expected, 2.0 * moving.expected)


def test_what_is_known_of_parts_is_that_of_the_whole(planar, moving):
    first, second = (
        Operation.of(planar, Motion(*(x[k] for x in (moving.t, moving.q, moving.v, moving.a))))
        for k in (slice(0, 1), slice(1, None))
    )
    whole = Operation.of(planar, moving).made_of((first, second))
    for name in ("own_friction", "transmitted", "inertia", "steepest"):
        np.testing.assert_allclose(whole.__dict__[name], getattr(moving, name), atol=1e-12)


def test_parts_of_another_robot_tell_nothing(planar, moving):
    other = replace(planar, coulomb_friction=2.0 * planar.coulomb_friction)
    assert not moving.made_of((Operation.of(other, moving),)).__dict__.keys() & {"own_friction", "inertia"}


def test_partials_are_those_of_pinocchio(planar, moving):
    data = planar.model.createData()
    pin.computeRNEADerivatives(planar.model, data, moving.q[3], moving.v[3], moving.a[3])
    to_q, to_v, mass = (part[3] for part in moving.partials)
    np.testing.assert_allclose(to_q, data.dtau_dq, atol=1e-12)
    np.testing.assert_allclose(to_v, data.dtau_dv, atol=1e-12)
    np.testing.assert_allclose(mass, pin.crba(planar.model, planar.model.createData(), moving.q[3]), atol=1e-12)


def test_what_effects_keep_in_a_copy_short_lived_copy_is_not_kept_in_the_operation(moving):
    moving.kept["before", 0] = moving.tau
    short = moving.short_lived_copy()
    short.kept["after", 0] = moving.tau
    assert short.kept["before", 0] is moving.kept["before", 0]
    assert ("after", 0) not in moving.kept


def test_the_rate_of_the_expected_torque_is_that_of_the_last_fit(moving):
    # Oracle: a torque that rises evenly.
    rising = moving.after_fit(np.outer(moving.t, np.arange(1.0, moving.tau.shape[1] + 1)))
    assert moving.expected_rate is not rising.expected_rate
    np.testing.assert_allclose(rising.expected_rate, np.arange(1.0, moving.tau.shape[1] + 1) * np.ones_like(moving.tau))
