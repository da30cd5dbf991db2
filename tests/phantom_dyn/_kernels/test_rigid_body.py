"""Compiled rigid-body dynamics against Pinocchio, and what they refuse."""

import logging

import numpy as np
import pinocchio as pin
import pytest

from benchmarks import pinocchio_loops
from phantom_dyn._kernels import rigid_body
from phantom_dyn._kernels.tree_arrays import tree_arrays
from phantom_dyn.errors import LogError, ParameterError, RobotError
from phantom_dyn.model.loading import load_robot

SAMPLES = 7


def model_of(*joints: pin.JointModel, parents: tuple[int, ...] | None = None, seed: int = 0) -> pin.Model:
    """Joints with random placements and bodies, each on the joint before it or on the given one."""
    rng, model = np.random.default_rng(seed), pin.Model()
    model.gravity = pin.Motion(rng.normal(size=3) * 9, np.zeros(3))
    for k, joint in enumerate(joints):
        rotation = pin.exp3(rng.normal(size=3))
        parent = k if parents is None else parents[k]
        index = model.addJoint(parent, joint, pin.SE3(rotation, rng.normal(size=3)), f"j{k}")
        spread = rng.normal(size=(4, 3))
        inertia = pin.Inertia(rng.uniform(0.1, 3), rng.normal(size=3), spread.T @ spread)
        model.appendBodyToJoint(index, inertia, pin.SE3.Identity())
        placement = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        model.addFrame(pin.Frame(f"f{k}", index, 0, placement, pin.FrameType.OP_FRAME))
    model.armature = rng.uniform(0, 1, model.nv)
    return model


def random_tree(seed: int) -> pin.Model:
    """Nine joints of any kind that the loops know, each on any joint before it."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=(9, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    kinds = [
        pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ, pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ,
        pin.JointModelRUBX, pin.JointModelRUBY, pin.JointModelRUBZ,
    ]  # fmt: skip
    turned = [pin.JointModelRevoluteUnaligned, pin.JointModelPrismaticUnaligned]
    drawn = rng.integers(0, 11, 9)
    joints = [kinds[d]() if d < 9 else turned[d - 9](axis[k]) for k, d in enumerate(drawn)]
    return model_of(*joints, parents=tuple(int(rng.integers(0, k + 1)) for k in range(9)), seed=seed)


TURNED_WHEEL = """<robot name="wheel"><link name="base"/><link name="wheel"><inertial><mass value="2"/>
<origin xyz="0.1 0.2 0.3"/><inertia ixx="0.3" ixy="0.01" iyy="0.4" ixz="0.02" iyz="0.03" izz="0.5"/></inertial></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="wheel"/><origin xyz="1 2 3" rpy="0.1 0.2 0.3"/>
<axis xyz="0.6 0 0.8"/></joint></robot>"""

AXIS = np.array([1.0, 2.0, -2.0]) / 3

MODELS = {
    "ur10": lambda: load_robot("example:ur10").model,
    "panda": lambda: load_robot("example:panda").model,
    "continuous": lambda: load_robot("example:double_pendulum_continuous").model,
    "continuous, unaligned": lambda: pin.buildModelFromXML(TURNED_WHEEL),
    "one joint": lambda: model_of(pin.JointModelRY()),
    "one linear joint": lambda: model_of(pin.JointModelPZ()),
    "unaligned": lambda: model_of(pin.JointModelRevoluteUnaligned(AXIS), pin.JointModelPrismaticUnaligned(AXIS)),
    "no joint": pin.Model,
    **{f"random tree {seed}": lambda seed=seed: random_tree(seed) for seed in range(6)},
}


@pytest.fixture(params=MODELS)
def model(request) -> pin.Model:
    return MODELS[request.param]()


@pytest.fixture
def samples(model, rng) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    tangent, v, a = rng.normal(size=(3, SAMPLES, model.nv)) * 2
    neutral = pin.neutral(model)
    q = np.array([pin.integrate(model, neutral, x) for x in tangent]).reshape(SAMPLES, model.nq)
    return q, v, a


def assert_agrees(found: np.ndarray, expected: np.ndarray) -> None:
    assert found.shape == expected.shape
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max(initial=0))


def test_the_regressor_is_that_of_pinocchio(model, samples):
    assert_agrees(rigid_body.regressor(model, tree_arrays(model), *samples), pinocchio_loops.regressor(model, *samples))


def test_the_torque_is_that_of_pinocchio(model, samples):
    assert_agrees(rigid_body.torque(model, tree_arrays(model), *samples), pinocchio_loops.torque(model, *samples))


def test_the_weight_under_any_gravity_is_that_of_pinocchio(model, samples, rng):
    pull = rng.normal(size=3)
    assert_agrees(
        rigid_body.weight(model, tree_arrays(model), samples[0], pull), pinocchio_loops.weight(model, samples[0], pull)
    )


def test_the_mass_matrix_is_the_slope_of_pinocchios_torque(model, samples):
    # Not against `pin.crba`, which wants the joints of a branch one after the other.
    q, weight = samples[0], pinocchio_loops.torque(model, samples[0], *np.zeros((2, SAMPLES, model.nv)))
    expected = np.empty((SAMPLES, model.nv, model.nv))
    for column, unit in enumerate(np.eye(model.nv)):
        one = np.broadcast_to(unit, (SAMPLES, model.nv))
        expected[:, :, column] = pinocchio_loops.torque(model, q, np.zeros((SAMPLES, model.nv)), one) - weight
    assert_agrees(rigid_body.mass(model, tree_arrays(model), q), expected)


@pytest.mark.parametrize("seed", [0, 2, 4])
def test_the_slopes_are_those_of_pinocchios_torque(seed, rng, monkeypatch):
    monkeypatch.setattr(rigid_body, "_WORTH_COMPILING", 0)
    # Central differences: Pinocchio's own slopes want the joints of a branch one after the other.
    model = random_tree(seed)
    q = np.array([pin.integrate(model, pin.neutral(model), x) for x in rng.normal(size=(SAMPLES, model.nv))])
    samples = q, *rng.normal(size=(2, SAMPLES, model.nv))
    _, v, a = samples
    for found, rate in zip(rigid_body.torque_slopes(model, tree_arrays(model), *samples), (False, True), strict=True):
        expected = np.empty((SAMPLES, model.nv, model.nv))
        for column, unit in enumerate(1e-5 * np.eye(model.nv)):
            sides = []
            for step in (unit, -unit):
                there = q if rate else np.array([pin.integrate(model, x, step) for x in q])
                sides.append(pinocchio_loops.torque(model, there, v + rate * step, a))
            expected[:, :, column] = (sides[0] - sides[1]) / 2e-5
        scale = np.abs(pinocchio_loops.torque(model, *samples)).max(initial=1.0)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * scale)


@pytest.mark.parametrize("body", [True, False], ids=["body", "hybrid"])
def test_the_jacobian_of_each_frame_is_that_of_pinocchio(model, samples, body):
    for frame in range(0, model.nframes, 3):
        found = rigid_body.frame_jacobian(model, tree_arrays(model), samples[0], frame, body=body)
        assert_agrees(found, pinocchio_loops.frame_jacobian(model, samples[0], frame, body))


def test_the_pose_of_each_frame_is_that_of_pinocchio(model, samples):
    for frame in range(0, model.nframes, 3):
        found = rigid_body.frame_pose(model, tree_arrays(model), samples[0], frame)
        for part, expected in zip(found, pinocchio_loops.frame_pose(model, samples[0], frame), strict=True):
            assert_agrees(part, expected)


def test_chosen_columns_are_those_of_all(model, samples, rng):
    p = 10 * (model.njoints - 1)
    columns = tuple(np.flatnonzero(rng.random(p) < 0.6).tolist())
    some = rigid_body.regressor(model, tree_arrays(model), *samples, columns=columns)
    assert_agrees(some, pinocchio_loops.regressor(model, *samples)[:, :, list(columns)])


@pytest.mark.parametrize("varies", [True, False], ids=["varying", "constant"])
def test_the_rows_of_a_closed_chain_are_those_of_the_tree_projected(model, samples, rng, varies):
    G = rng.normal(size=(SAMPLES if varies else 1, model.nv, 2))
    slope = np.broadcast_to(G, (SAMPLES, model.nv, 2))
    found = rigid_body.regressor(model, tree_arrays(model), *samples, slope=slope)
    assert_agrees(found, np.swapaxes(slope, 1, 2) @ pinocchio_loops.regressor(model, *samples))


def test_a_block_that_is_used_again_holds_the_new_samples_beside_what_is_not_its_own(rng):
    model = random_tree(2)
    first, second = rng.normal(size=(2, 3, SAMPLES, model.nv))
    q = [np.array([pin.integrate(model, pin.neutral(model), x) for x in block[0]]) for block in (first, second)]
    out = np.zeros((SAMPLES, model.nv, 91))
    out[:, :, 90] = 5.0
    for k, block in enumerate((first, second)):
        rigid_body.regressor(model, tree_arrays(model), q[k], *block[1:], out=out)
    assert_agrees(out[:, :, :90], pinocchio_loops.regressor(model, q[1], *second[1:]))
    np.testing.assert_array_equal(out[:, :, 90], 5.0)


@pytest.mark.parametrize(
    "joint", [pin.JointModelSpherical(), pin.JointModelPlanar(), pin.JointModelHX(0.1), pin.JointModelFreeFlyer()]
)
def test_joints_of_other_kinds_are_refused(joint):
    with pytest.raises(RobotError, match=rf"A joint is a {joint.shortname()}: give a model of revolute, continuous"):
        tree_arrays(model_of(pin.JointModelRX(), joint))


def test_a_changed_gravity_of_a_model_counts_at_once(rng):
    model = random_tree(4)
    arrays, v = tree_arrays(model), rng.normal(size=(1, model.nv))
    q = pin.neutral(model)[None]
    model.gravity = pin.Motion(np.array([1.0, 2.0, 3.0]), np.zeros(3))
    assert_agrees(rigid_body.torque(model, arrays, q, v, v), pinocchio_loops.torque(model, q, v, v))


def test_no_samples_give_no_rows():
    model = random_tree(0)
    arrays, empty = tree_arrays(model), (np.empty((0, model.nq)), np.empty((0, model.nv)), np.empty((0, model.nv)))
    assert rigid_body.regressor(model, arrays, *empty).shape == (0, model.nv, 90)
    assert rigid_body.regressor(model, arrays, *empty, slope=np.empty((0, model.nv, 2))).shape == (0, 2, 90)
    assert rigid_body.torque(model, arrays, *empty).shape == (0, model.nv)
    assert rigid_body.mass(model, arrays, empty[0]).shape == (0, model.nv, model.nv)
    assert rigid_body.frame_jacobian(model, arrays, empty[0], 0, body=True).shape == (0, 6, model.nv)


def test_samples_of_another_robot_are_refused():
    model = random_tree(0)
    wrong = np.zeros((2, model.nq)), np.zeros((2, model.nv - 1)), np.zeros((2, model.nv))
    with pytest.raises(LogError, match=rf"do not fit a robot of {model.nq} configuration entries and {model.nv} veloc"):
        rigid_body.torque(model, tree_arrays(model), *wrong)


def test_a_gravity_of_two_components_is_refused():
    model = random_tree(0)
    with pytest.raises(ParameterError, match=r"gravity has shape \(2,\): give three components"):
        rigid_body.weight(model, tree_arrays(model), pin.neutral(model)[None], np.zeros(2))


def strided(x: np.ndarray) -> np.ndarray:
    return np.repeat(x, 2, axis=0)[::2]


OTHER_LAYOUTS = {
    "strided": strided,
    "Fortran order": np.asfortranarray,
    "backwards": lambda x: x[::-1].copy()[::-1],
    "big-endian": lambda x: x.astype(">f8"),
    "read-only": lambda x: np.frombuffer(x.tobytes()).reshape(x.shape),
}


@pytest.mark.parametrize("layout", OTHER_LAYOUTS)
def test_samples_in_another_layout_give_the_same(layout, rng):
    model = load_robot("example:ur10").model
    samples, arrays = rng.normal(size=(3, SAMPLES, 6)), tree_arrays(model)
    other = [OTHER_LAYOUTS[layout](x) for x in samples]
    np.testing.assert_array_equal(
        rigid_body.regressor(model, arrays, *other), rigid_body.regressor(model, arrays, *samples)
    )
    np.testing.assert_array_equal(rigid_body.torque(model, arrays, *other), rigid_body.torque(model, arrays, *samples))
    np.testing.assert_array_equal(rigid_body.mass(model, arrays, other[0]), rigid_body.mass(model, arrays, samples[0]))


@pytest.mark.parametrize("kind", [np.int64, np.float32, bool])
def test_whole_numbers_give_what_the_same_floats_give(kind, rng):
    model = load_robot("example:ur10").model
    samples, arrays = rng.integers(0, 2, size=(3, SAMPLES, 6)), tree_arrays(model)
    found = rigid_body.regressor(model, arrays, *samples.astype(kind))
    np.testing.assert_array_equal(found, rigid_body.regressor(model, arrays, *samples.astype(float)))
    # No machine code of its own for every kind of number.
    assert len(getattr(rigid_body.regressor_loop, "signatures", ())) <= 2


@pytest.mark.parametrize("columns", [(3, 2), (4, 4), (-1, 3), (10,), (1.5,)])
def test_columns_that_do_not_ascend_or_do_not_exist_are_refused(columns):
    # At the kernel: the type checker of the tests stops a fraction before the public function.
    model, still = load_robot("emps").model, np.zeros((1, 1))
    with pytest.raises(ParameterError, match="give ascending column numbers from 0 to 9"):
        rigid_body.regressor(model, tree_arrays(model), still, still, still, columns=columns)


@pytest.mark.parametrize(
    "out",
    [np.zeros((3, 1, 9)), np.zeros((2, 1, 10)), np.zeros((3, 1, 10), np.float32), np.zeros((3, 1, 20))[:, :, ::2]],
)
def test_room_that_does_not_fit_is_refused(out):
    model, still = load_robot("emps").model, np.zeros((3, 1))
    with pytest.raises(ParameterError, match=r"give a C-contiguous array of floats .*of shape \(3, 1, 10\)"):
        rigid_body.regressor(model, tree_arrays(model), still, still, still, out=out)


def test_the_first_use_says_what_it_waits_for(caplog):
    class Loop:
        signatures = ()

    with caplog.at_level(logging.INFO, "phantom_dyn"):
        rigid_body.announce(Loop())  # type: ignore[arg-type]
    assert "Preparing compiled loops over samples" in caplog.text
