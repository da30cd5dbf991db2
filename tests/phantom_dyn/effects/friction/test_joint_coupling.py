from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from phantom_dyn.effects.friction.joint_coupling import JointCoupling
from phantom_dyn.effects.operation import Operation
from phantom_dyn.errors import RobotError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

EFFECT = JointCoupling()
THETA = np.array([-0.7, 0.3, 0.2, 0.05])  # ratio, T, c, I


def test_the_torque_follows_the_contract(arm, smooth):
    # Contract: w = v_i + ratio v_j; -(T sign w + c w + I dw/dt) times (1, ratio) on (i, j).
    torque = EFFECT.torque(arm, smooth, "turn+slide", THETA)
    w = smooth.v[:, 0] - 0.7 * smooth.v[:, 2]
    dw = smooth.a[:, 0] - 0.7 * smooth.a[:, 2]
    inner = 0.3 * np.sign(w) + 0.2 * w + 0.05 * dw
    np.testing.assert_allclose(torque, np.column_stack([-inner, 0 * w, 0.7 * inner]), atol=1e-12)


def test_parameters_have_the_names_of_the_contract_and_the_units_of_the_first_joint(arm):
    given = {p.name: p.unit for p in EFFECT.parameters(arm, "tilt+slide")}
    assert given == {"ratio": "1", "coulomb_torque": "N m", "coefficient": "N m s/rad", "inertia": "kg m^2"}


def test_an_unknown_second_joint_is_refused(arm, smooth):
    with pytest.raises(RobotError, match=r"No joint 'knee' in this robot: its joints are turn, tilt, slide\."):
        EFFECT.torque(arm, smooth, "turn+knee", THETA)


def test_a_simulation_gives_the_same_friction(arm, smooth, torque_in_steps):
    without_inertia = np.array([-0.7, 0.3, 0.2, 0.0])
    expected = EFFECT.torque(arm, smooth, "turn+slide", without_inertia)
    simulated = EFFECT.simulated(arm, "turn+slide", THETA)
    np.testing.assert_allclose(torque_in_steps(simulated, smooth), expected, atol=1e-12)


def test_a_simulation_adds_the_inertia_to_the_mass_matrix(arm, smooth):
    expected = EFFECT.torque(arm, smooth, "turn+slide", np.array([-0.7, 0.0, 0.0, 0.05]))
    inertia = EFFECT.simulated(arm, "turn+slide", THETA).inertia
    np.testing.assert_allclose(-smooth.a @ inertia, expected, atol=1e-12)


def test_a_joint_at_rest_hides_the_coupling(arm, smooth):
    q, v, a = (x * [1.0, 0.0, 1.0] for x in (smooth.q, smooth.v, smooth.a))
    still = Operation.of(arm, Motion(smooth.t, q, v, a))
    why = EFFECT.untestable(arm, still, "turn+tilt")
    assert why == "tilt does not move: a coupling looks like friction of the other joint"
    assert EFFECT.untestable(arm, replace(still), "turn+slide") is None


def test_joints_on_one_line_hide_the_coupling(arm, smooth):
    # By hand: of proportional speeds, sum and difference have the signs and sizes of each alone.
    v = smooth.v.copy()
    v[:, 1] = -0.4 * v[:, 0]
    why = EFFECT.untestable(arm, Operation.of(arm, Motion(smooth.t, smooth.q, v, smooth.a)), "turn+tilt")
    assert why == "turn and tilt move along one line: a coupling looks like friction of each"


def test_friction_and_inertia_are_not_negative(arm):
    assert EFFECT.coefficient_bounds(arm, "turn+tilt", (1.0,)) == ((0.0, np.inf),) * 3


@pytest.mark.parametrize(("travel", "hidden"), [(0.9e-4, True), (1.1e-4, False)])
def test_a_joint_that_travels_a_tenth_of_a_milliradian_counts_as_moving(arm, smooth, travel, hidden):
    # Closed form: of a ramp the middle 98 % count.
    q = smooth.q.copy()
    q[:, 1] = np.linspace(0.0, travel / 0.98, len(q))
    why = EFFECT.untestable(arm, Operation.of(arm, Motion(smooth.t, q, smooth.v, smooth.a)), "turn+tilt")
    assert (why is not None) is hidden


@pytest.mark.parametrize(
    ("pair", "sits"),
    [
        ("turn+slide", True),
        ("slide+turn", True),
        ("turn", False),
        ("turn+knee", False),
        (None, False),
        ("a+b+c", False),
    ],
)
def test_a_coupling_sits_between_any_two_joints_of_the_robot(arm, pair, sits):
    assert EFFECT.can_sit(arm, pair) is sits


def test_the_probe_is_its_coulomb_friction(arm, smooth):
    name, direction = EFFECT.probe(arm, smooth, "turn+slide")
    theta = EFFECT.from_coefficients(arm, "turn+slide", direction, (0.5,))
    assert [p.name for p in EFFECT.parameters(arm, "turn+slide")].index(name) == 1
    np.testing.assert_array_equal(theta, [0.5, 1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("names", "pairs"), [("abcd", "ab ac ad bc bd cd"), ("abcde", "ab ac bc bd cd ce de"), ("ab", "ab"), ("a", "")]
)
def test_beyond_four_joints_a_belt_spans_one_joint_at_most(names, pairs):
    places = EFFECT.places(Mock(spec=Robot, joint_names=tuple(names)))
    assert places == tuple("+".join(pair) for pair in pairs.split())


def test_the_speeds_of_a_belt_that_turns_its_joints_alike_or_against_each_other_are_tried(arm, smooth):
    assert EFFECT.shapes(arm, smooth, "turn+slide") == ((1.0,), (-1.0,))
    assert [ratio for (ratio,) in EFFECT.refined(np.zeros(3), (-2.0,))] == pytest.approx([-1.6, -1.86, -2, -2.14, -2.5])


def test_a_coupling_in_the_model_has_both_joints_and_the_numbers_of_the_contract(arm):
    coupling = EFFECT.model_numbers(arm, "turn+slide", THETA).coupling
    assert (coupling.first, coupling.second) == ("turn", "slide")
    assert (coupling.ratio, coupling.coulomb_torque, coupling.coefficient, coupling.inertia) == tuple(THETA)
