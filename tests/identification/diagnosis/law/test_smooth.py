"""The oracles are a known truth and the sum of weights of interpolation."""

import numpy as np

from identification.diagnosis.law.smooth import hats, input_curves, input_gains
from rests import made_up_rest


def test_linear_functions_are_interpolated_exactly():
    places = np.array([-1.0, -0.2, 0.5, 2.0])
    x = np.linspace(-1.0, 2.0, 31)
    np.testing.assert_allclose(hats(x, places) @ (3 * places + 1), 3 * x + 1)


def test_beyond_the_ends_the_value_of_the_end_holds():
    np.testing.assert_allclose(hats(np.array([-5.0, 9.0]), np.array([0.0, 1.0])) @ np.array([2.0, 7.0]), [2.0, 7.0])


def test_the_input_of_the_law_foresees_most():
    gains = input_gains(made_up_rest(lambda x: x["q.j1"] ** 3)).told
    assert gains[0].inputs == ("q.j1",)
    assert gains[0].gain > 0.9 > gains[0].chance


def test_an_input_that_has_no_part_is_not_beyond_chance():
    gains = {one.inputs: one for one in input_gains(made_up_rest(lambda x: x["q.j1"] ** 3)).told}
    assert gains["v.j2",].gain < gains["v.j2",].chance


def test_a_pair_foresees_what_neither_of_its_inputs_does():
    gains = {one.inputs: one.gain for one in input_gains(made_up_rest(lambda x: x["q.j2"] * np.sign(x["v.j1"]))).told}
    best = max(gains, key=lambda names: gains[names])
    assert set(best) in ({"v.j1", "q.j2"}, {"dx.j1", "q.j2"})
    assert gains[best] > 0.8 > 0.4 > max(gains["v.j1",], gains["q.j2",])


def test_a_curve_is_the_torque_on_the_joint_and_its_band_holds_the_truth():
    (curve,) = input_curves(made_up_rest(lambda x: 2.0 * x["q.j1"]), ("q.j1",))
    x, middle = np.array(curve.x), np.array(curve.middle)
    np.testing.assert_allclose(middle[3:-3], -2.0 * x[3:-3], atol=0.1)
    inside = (np.array(curve.low) <= -2.0 * x + 0.03) & (-2.0 * x - 0.03 <= np.array(curve.high))
    assert inside.mean() > 0.8


def test_friction_has_a_curve_for_each_direction():
    curves = input_curves(made_up_rest(lambda x: x["q.j1"] * np.sign(x["v.j1"])), ("q.j1", "v.j1"))
    assert [(one.input, one.direction) for one in curves] == [
        ("q.j1", "forwards"), ("q.j1", "backwards"), ("v.j1", ""),
    ]  # fmt: skip
