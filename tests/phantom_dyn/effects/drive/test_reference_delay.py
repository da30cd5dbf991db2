"""Late references. Oracles: closed forms of sines, MuJoCo-free simulations of a shifted reference, known truth."""

from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn import load_robot
from phantom_dyn.effects.drive.reference_delay import ReferenceDelay
from phantom_dyn.effects.operation import Operation, References
from phantom_dyn.errors import ParameterError
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import Cause, simulate
from places import ROBOTS

EFFECT = ReferenceDelay()
W, GAIN = 6.0, np.array([40.0, 0.0, 15.0])


def sine(t: np.ndarray) -> np.ndarray:
    return 0.5 * np.sin(W * t)[:, None] * [1.0, 2.0, 3.0]


@pytest.fixture
def followed(smooth) -> Operation:
    """References are sines; the second joint follows none."""
    q_ref = sine(smooth.t)
    loop = References(
        smooth.t, q_ref, GAIN * (q_ref - smooth.q), GAIN, np.full(3, np.inf), np.zeros(3), np.full(3, np.inf)
    )
    return replace(smooth, references=loop)


@pytest.mark.parametrize("delay", [0.01, 0.0333])
def test_the_torque_is_that_of_the_reference_a_delay_before(arm, followed, delay):
    # Closed form: kp times the change of a sine.
    found = EFFECT.torque(arm, followed, None, np.array([delay]))
    wanted = GAIN * (sine(followed.t - delay) - sine(followed.t))
    np.testing.assert_allclose(found[50:], wanted[50:], atol=2e-3)


def test_the_column_is_exact_where_coefficient_and_shape_agree(arm, followed):
    signature = EFFECT.signature(arm, followed, None, (0.02,))
    torque = EFFECT.torque(arm, followed, None, np.array([0.02]))
    np.testing.assert_allclose(torque, -signature.columns @ [0.02], atol=1e-12)


def test_one_joint_touches_no_other(arm, followed):
    joint = arm.joint_names[2]
    assert EFFECT.signature(arm, followed, joint, (0.02,)).rows == (2,)
    assert np.all(EFFECT.torque(arm, followed, joint, np.array([0.02]))[:, :2] == 0)


def test_a_drive_at_its_limit_gives_no_more_for_a_late_reference(arm, followed):
    # By hand: where both torques are beyond the limit nothing changes.
    limits = np.array([3.0, 3.0, 3.0])
    clipped = replace(followed, references=replace(followed.references, limits=limits))
    commanded = followed.references.commanded
    then = commanded + GAIN * (sine(followed.t - 0.02) - sine(followed.t))
    same = (np.minimum(commanded, then) > 3.0) | (np.maximum(commanded, then) < -3.0)
    found = EFFECT.torque(arm, clipped, None, np.array([0.02]))
    assert same[50:, 0].sum() > 100
    assert np.all(np.abs(found[50:][same[50:]]) < 1e-9)


def test_without_references_it_is_not_testable(arm, smooth, followed):
    assert EFFECT.untestable(arm, smooth, None) is not None
    assert EFFECT.untestable(arm, followed, arm.joint_names[1]) is not None
    assert EFFECT.untestable(arm, followed, arm.joint_names[0]) is None


def test_behind_a_torque_sensor_it_leaves_no_trace(arm, followed):
    assert "sensor" in str(EFFECT.untestable(replace(arm, torque_source="sensor"), followed, None))


def test_what_was_read_of_the_delay_bounds_it(arm, followed):
    known = replace(followed.references, least=np.full(3, 0.02), most=np.full(3, 0.03))
    joint = arm.joint_names[0]
    assert EFFECT.bounds_in(arm, replace(followed, references=known), joint, (0.01,)) == ((0.02, 0.03),)
    assert EFFECT.bounds_in(arm, followed, joint, (0.01,)) == ((0.0, 1.0),)


@pytest.fixture(scope="module")
def law():
    t = np.arange(2000) / 500.0
    q_ref = 0.6 * np.sin(3.0 * t)[:, None]
    return position_control(t, q_ref, np.zeros_like(q_ref), kp=np.array([30.0]), kd=np.array([2.0]))


def test_a_simulation_with_it_is_that_of_the_shifted_reference(law):
    # Shifted by five samples, before the first of which the reference rests.
    robot = load_robot(ROBOTS / "pendulum.urdf")
    late = Cause(EFFECT, robot.joint_names[0], np.array([0.01]))
    q_ref = np.vstack([np.repeat(law.q_ref[:1], 5, axis=0), law.q_ref[:-5]])
    shifted = replace(law, q_ref=q_ref)
    runs = ((late,), law), ((), shifted)
    ours, plain = (simulate(robot, causes, one, law.t, np.zeros(1)).q for causes, one in runs)
    np.testing.assert_allclose(ours, plain, atol=1e-9)


def test_a_controller_without_tables_is_refused(law):
    robot = load_robot(ROBOTS / "pendulum.urdf")
    late = Cause(EFFECT, robot.joint_names[0], np.array([0.01]))
    with pytest.raises(ParameterError, match="give a Tracking of tables"):
        simulate(robot, (late,), lambda t, q, v: 0.0 * q, law.t, np.zeros(1))


def test_model_files_get_it_as_a_delay_of_references(arm):
    numbers = EFFECT.model_numbers(arm, None, np.array([0.03]))
    assert (numbers.whole, numbers.reference_delay, numbers.delay) == (True, 0.03, None)


def test_a_held_reference_is_reported_as_what_looks_the_same(arm):
    # Closed form: held for 40 ms, it is 20 ms late on average.
    said = EFFECT.remark(arm, None, np.array([0.02]))
    assert "every 40 ms" in said
    assert EFFECT.remark(replace(arm, reference_hold="zoh"), None, np.array([0.02])) == ""
