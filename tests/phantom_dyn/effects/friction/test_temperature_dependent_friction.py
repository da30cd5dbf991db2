from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.effects.friction.temperature_dependent_friction import TemperatureDependentFriction
from phantom_dyn.effects.operation import Operation
from phantom_dyn.motion import Motion

EFFECT = TemperatureDependentFriction()
THETA = np.array([0.9, 0.3, -0.02, -0.005, 35.0])


def test_the_torque_follows_the_law(arm, smooth):
    # By hand: -((T + kT d) s + (c + kc d) v), d the temperature above the reference.
    v, d = smooth.v[:, 1], smooth.temperature[:, 1] - 35.0
    expected = -(0.9 - 0.02 * d) * np.sign(v) - (0.3 - 0.005 * d) * v
    np.testing.assert_allclose(EFFECT.torque(arm, smooth, "tilt", THETA)[:, 1], expected, atol=1e-12)


@pytest.mark.parametrize("temperature", [None, np.full((2000, 3), np.nan)], ids=["no joint", "not this joint"])
def test_where_no_temperature_is_known_it_acts_as_at_the_reference(arm, smooth, temperature):
    v = smooth.v[:, 1]
    found = EFFECT.torque(arm, replace(smooth, temperature=temperature), "tilt", THETA)[:, 1]
    np.testing.assert_allclose(found, -0.9 * np.sign(v) - 0.3 * v, atol=1e-12)


def test_the_reference_is_the_mean_temperature_in_steps_of_five_degrees(arm, smooth):
    # By hand: from 30 to 46 degrees the mean is 38.
    assert EFFECT.shapes(arm, smooth, "tilt") == ((40.0,),)


def test_a_simulation_is_at_the_mean_temperature_of_its_operation(arm, smooth):
    # By hand: of half an operation that warms up from 30 by 4 degrees a second for two seconds.
    first = Operation.of(arm, Motion(*(getattr(smooth, name)[:1000] for name in "tqva")))
    warm = replace(first, temperature=smooth.temperature[:1000])
    mean = float(smooth.temperature[:1000, 1].mean())
    assert mean == pytest.approx(34.0, abs=0.01)
    expected = [0.9 - 0.02 * (mean - 35.0), 0.3 - 0.005 * (mean - 35.0), 0.0, 0.0, mean]
    np.testing.assert_allclose(EFFECT.at_work(warm, "tilt", THETA), expected)
    np.testing.assert_array_equal(EFFECT.at_work(first, "tilt", THETA), THETA)


def test_a_joint_without_a_temperature_cannot_show_it(arm, smooth):
    why = "the temperature of its drive was not recorded (column temp.tilt)"
    lacking = smooth.temperature.copy()
    lacking[3, 1] = np.nan
    assert EFFECT.untestable(arm, replace(smooth, temperature=None), "tilt") == why
    assert EFFECT.untestable(arm, replace(smooth, temperature=lacking), "tilt") == why
    assert EFFECT.untestable(arm, replace(smooth, temperature=lacking), "turn") is None


def test_a_temperature_that_hardly_changes_cannot_show_it(arm, smooth):
    level = replace(smooth, temperature=40.0 + 0.1 * (smooth.temperature - 40.0))
    why = EFFECT.untestable(arm, level, "tilt")
    assert why == "the temperature of tilt changes by 1.5 °C only, wanted 3 °C or more"


def test_a_joint_that_never_reverses_cannot_show_it(arm, smooth):
    forwards = Operation.of(
        arm, Motion(smooth.t, smooth.q, np.abs(smooth.v) + 0.1, smooth.a), temperature=smooth.temperature
    )
    assert EFFECT.untestable(arm, forwards, "turn") == "turn never reverses: its friction looks like a constant torque"


def test_friction_holds_back_at_the_reference_and_may_fall_or_grow(arm):
    rubbing = replace(arm, viscous_friction=np.array([0.0, 0.3, 0.0]), coulomb_friction=np.array([0.0, 0.7, 0.0]))
    free = (-np.inf, np.inf)
    assert EFFECT.coefficient_bounds(rubbing, "tilt", (40.0,)) == ((-0.7, np.inf), (-0.3, np.inf), free, free)
