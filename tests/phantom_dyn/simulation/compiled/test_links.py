# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn._kernels.single_state import at_root, invert, joint_rows, mass_and_bias
from phantom_dyn._kernels.tree_arrays import tree_arrays

AXIS = np.array([0.48, -0.6, 0.64])
JOINTS = (
    pin.JointModelRX,
    pin.JointModelRZ,
    pin.JointModelPY,
    pin.JointModelRUBY,
    lambda: pin.JointModelPrismaticUnaligned(AXIS),
    lambda: pin.JointModelRevoluteUnaligned(AXIS),
)


def random_tree(seed: int, joints: int) -> pin.Model:
    """Joints of all kinds, each on the last one or on one that carries that: Pinocchio wants branches in a row."""
    rng, model, path = np.random.default_rng(seed), pin.Model(), [0]
    pin.seed(seed)
    for j in range(joints):
        made = JOINTS[rng.integers(len(JOINTS))]()
        path = path[: int(rng.integers(len(path))) + 1]
        body = model.addJoint(path[-1], made, pin.SE3.Random(), f"joint{j}")
        path.append(body)
        model.appendBodyToJoint(body, pin.Inertia.Random(), pin.SE3.Random())
    model.gravity = pin.Motion(rng.normal(size=3) * 9.81, np.zeros(3))
    return model


@pytest.mark.parametrize("joints", [1, 2, 5, 9])
@pytest.mark.parametrize("seed", range(4))
def test_mass_matrix_and_coasting_torque_of_a_branched_tree_are_pinocchios(joints, seed):
    model = random_tree(seed, joints)
    arrays = tree_arrays(model)
    assert arrays is not None
    rng = np.random.default_rng(seed)
    q, v = rng.uniform(-2.0, 2.0, (2, model.nv))
    mass, bias = np.zeros((model.nv, model.nv)), np.zeros(model.nv)
    mass_and_bias(*joint_rows(arrays), at_root(model.njoints, model.gravity.linear), q, v, mass, bias)

    configuration, data = np.empty(model.nq), model.createData()
    for joint in list(model.joints)[1:]:
        own = [q[joint.idx_v]] if joint.nq == 1 else [np.cos(q[joint.idx_v]), np.sin(q[joint.idx_v])]
        configuration[joint.idx_q : joint.idx_q + joint.nq] = own
    upper = np.triu(pin.crba(model, data, configuration))
    expected = upper + np.triu(upper, 1).T
    np.testing.assert_allclose(mass, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())
    coasting = pin.nonLinearEffects(model, data, configuration, v)
    np.testing.assert_allclose(bias, coasting, rtol=0.0, atol=1e-12 * np.abs(coasting).max())


@pytest.mark.parametrize("n", [1, 2, 3, 7])
def test_the_inverse_is_numpys(n, rng):
    half = rng.normal(size=(n, n))
    matrix = half @ half.T + np.eye(n)
    inverse = matrix.copy()
    assert invert(inverse)
    np.testing.assert_allclose(inverse, np.linalg.inv(matrix), atol=1e-12)


def test_a_matrix_that_is_not_positive_definite_is_not_inverted():
    # Known truth: eigenvalues 3 and -1.
    assert not invert(np.array([[1.0, 2.0], [2.0, 1.0]]))
