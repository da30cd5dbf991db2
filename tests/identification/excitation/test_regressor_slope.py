import numpy as np
import pinocchio as pin
import pytest

from identification.excitation.regressor_slope import regressor_slope

N = 4


def tree() -> pin.Model:
    """A branched tree of every kind of joint: about x, along a skew axis, continuous, along z, about a skew axis."""
    model, rng = pin.Model(), np.random.default_rng(2)
    skew = np.array([0.6, 0.0, 0.8])
    kinds = [
        (0, pin.JointModelRX()),
        (1, pin.JointModelPrismaticUnaligned(skew)),
        (2, pin.JointModelRUBY()),
        (1, pin.JointModelPZ()),
        (4, pin.JointModelRevoluteUnaligned(skew)),
    ]
    for k, (parent, joint) in enumerate(kinds):
        body = model.addJoint(parent, joint, pin.SE3.Random(), f"j{k}")
        model.appendBodyToJoint(body, pin.Inertia.Random(), pin.SE3.Identity())
    model.gravity = pin.Motion(rng.normal(size=3), np.zeros(3))
    return model


def configuration(model: pin.Model, q: np.ndarray) -> np.ndarray:
    return np.array([*q[:2], np.cos(q[2]), np.sin(q[2]), *q[3:]])


def regressors(model: pin.Model, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    data = model.createData()
    rows = zip(q, v, a, strict=True)
    return np.array([pin.computeJointTorqueRegressor(model, data, configuration(model, x), y, z) for x, y, z in rows])


@pytest.fixture
def model() -> pin.Model:
    pin.seed(7)
    return tree()


@pytest.fixture
def motion(rng, model) -> list[np.ndarray]:
    return list(rng.normal(size=(3, N, model.nv)))


def test_the_sum_is_that_of_the_weighted_regressor(model, motion, rng):
    # Oracle: Pinocchio's regressor.
    S = rng.normal(size=(N, model.nv, 10 * model.nv))
    total, _ = regressor_slope(model, *motion, S)
    assert total == pytest.approx((S * regressors(model, *motion)).sum(), rel=1e-10)


@pytest.mark.parametrize(("which", "name"), [(0, "q"), (1, "v"), (2, "a")])
def test_the_slope_of_any_weights_is_that_of_differences(model, motion, rng, which, name):
    # Oracle: central differences of Pinocchio's regressor.
    S, h = rng.normal(size=(N, model.nv, 10 * model.nv)), 1e-6
    slope = getattr(regressor_slope(model, *motion, S)[1], name)
    for joint in range(model.nv):
        sides = []
        for step in (h, -h):
            moved = [part.copy() for part in motion]
            moved[which][:, joint] += step
            sides.append((S * regressors(model, *moved)).sum(axis=(1, 2)))
        np.testing.assert_allclose(slope[:, joint], (sides[0] - sides[1]) / (2 * h), rtol=1e-6, atol=1e-6)


def test_the_slope_of_a_torque_is_that_of_pinocchio(model, motion, rng):
    # Oracle: pin.computeRNEADerivatives, which is exact.
    pi = np.concatenate([inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]])
    pull, data = rng.normal(size=(N, model.nv)), model.createData()
    _, slope = regressor_slope(model, *motion, pull[:, :, None] * pi)
    for k in range(N):
        q, v, a = (part[k] for part in motion)
        pin.computeRNEADerivatives(model, data, configuration(model, q), v, a)
        np.testing.assert_allclose(slope.q[k], pull[k] @ data.dtau_dq, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(slope.v[k], pull[k] @ data.dtau_dv, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(slope.a[k], pull[k] @ pin.crba(model, data, configuration(model, q)), atol=1e-10)


def test_one_joint_and_one_sample():
    # Closed form: a point mass m at distance l about a horizontal axis; tau = m l^2 a + m g l sin q.
    model = pin.Model()
    body = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "pin")
    model.appendBodyToJoint(body, pin.Inertia(2.0, np.array([0.0, 0.0, -0.5]), np.zeros((3, 3))), pin.SE3.Identity())
    pi = model.inertias[1].toDynamicParameters()
    q, v, a = np.array([[0.3]]), np.array([[1.0]]), np.array([[2.0]])
    total, slope = regressor_slope(model, q, v, a, pi[None, None])
    assert total == pytest.approx(0.5 * 2.0 + 2.0 * 9.81 * 0.5 * np.sin(0.3))
    assert slope.q[0, 0] == pytest.approx(2.0 * 9.81 * 0.5 * np.cos(0.3))
    assert slope.v[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert slope.a[0, 0] == pytest.approx(0.5)
