"""Base parameters, of a CEA branch too."""

import os
import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import identification.regression.regressor
from identification.data.log import Band, Log
from identification.regression.base_parameters import base_parameters, base_parameters_of_matrix
from identification.regression.regressor import torque_regressor
from identification.regression.triangular import r_factor
from phantom_dyn.dynamics.dynamics import rigid_body_regressor, standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.inertia import parameter_names, parameter_units
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Actuator, Robot
from phantom_dyn.motion import Motion

UNFILTERED = Band(100.0, 50.0, np.ones(1), 1)

JOINTS = {"R": pin.JointModelRZ, "P": pin.JointModelPZ, "C": pin.JointModelRUBZ}


def serial_robot(kinds: str, placements, gravity=(0.0, 0.0, -9.81), rng=None) -> Robot:
    """Joints about or along their own z axis (R revolute, P prismatic, C continuous), random bodies."""
    rng = rng or np.random.default_rng(0)
    model = pin.Model()
    model.gravity.linear = np.array(gravity)
    for k, (kind, placement) in enumerate(zip(kinds, placements, strict=True)):
        joint = model.addJoint(k, JOINTS[kind](), placement, f"j{k + 1}")
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    model.armature = rng.uniform(0, 1, model.nv)
    n = len(kinds)
    prismatic = np.array([kind == "P" for kind in kinds])
    return Robot(
        model, "serial", "", "", tuple(model.names)[1:], (Actuator(),) * n, np.zeros(n), np.zeros(n), prismatic
    )


def placed(x: float = 0.0, rotation=None) -> pin.SE3:
    return pin.SE3(np.eye(3) if rotation is None else rotation, np.array([x, 0.0, 0.0]))


def some_motion(robot: Robot, rng, samples=200) -> Motion:
    return Motion(np.arange(samples) * 0.01, *rng.normal(size=(3, samples, robot.nv)))


def base_of(robot: Robot, rng, samples=200):
    W = rigid_body_regressor(robot, some_motion(robot, rng, samples)).reshape(samples * robot.nv, -1)
    return W, base_parameters_of_matrix(W, parameter_names(robot), parameter_units(robot))


PLANAR = ("RR", [placed(), placed(0.5)])


def test_a_planar_arm_without_gravity_has_the_four_known_parameters(rng):
    # Closed form: ZZ1R = ZZ1 + l^2 m2, MX2, MY2, ZZ2 with l = 0.5 m.
    base = base_of(serial_robot(*PLANAR, gravity=(0, 0, 0)), rng)[1]
    assert base.base_names == ("j1.IzzR", "j2.mx", "j2.my", "j2.Izz")
    assert base.regroupings() == ("j1.IzzR = j1.Izz + 0.25 j2.m",)


def test_a_planar_arm_under_gravity_has_the_six_known_parameters(rng):
    # Closed form: besides, MX1R = MX1 + l m2 and MY1.
    base = base_of(serial_robot(*PLANAR, gravity=(0, -9.81, 0)), rng)[1]
    assert base.base_names == ("j1.mxR", "j1.my", "j1.IzzR", "j2.mx", "j2.my", "j2.Izz")
    assert base.regroupings() == ("j1.mxR = j1.mx + 0.5 j2.m", "j1.IzzR = j1.Izz + 0.25 j2.m")


def test_a_pendulum_has_two_moments_and_one_inertia(rng):
    base = base_of(serial_robot("R", [placed()], gravity=(0, -9.81, 0)), rng)[1]
    assert base.base_names == ("j1.mx", "j1.my", "j1.Izz")


def test_a_slide_has_its_mass_only(rng):
    assert base_of(serial_robot("P", [placed()]), rng)[1].base_names == ("j1.m",)


def test_the_ur10_has_36_base_parameters(rng):
    # Published: 36 inertial base parameters of a six-axis arm whose first axis is vertical; numpy's SVD agrees.
    W, base = base_of(load_robot("example:ur10"), rng)
    assert base.rank == np.linalg.matrix_rank(W) == 36


def test_the_base_parameters_of_the_given_model_are_its_torque(rng):
    robot = load_robot("example:ur10")
    W, base = base_of(robot, rng)
    pi = standard_parameters(robot)
    np.testing.assert_allclose(W[:, base.independent] @ base.values(pi), W @ pi, atol=1e-9)


random_arms = given(
    kinds=st.text("RPC", min_size=1, max_size=4),
    seed=st.integers(0, 2**32 - 1),
    parallel=st.booleans(),
    samples=st.sampled_from([1, 2, 60]),
)


def random_arm(kinds, seed, parallel) -> tuple[Robot, np.random.Generator]:
    rng = np.random.default_rng(seed)
    pin.seed(seed)
    placements = [pin.SE3.Random() for _ in kinds]
    if parallel:  # all axes parallel: the case with most regroupings
        placements = [pin.SE3(np.eye(3), placement.translation) for placement in placements]
    return serial_robot(kinds, placements, rng=rng), rng


@random_arms
@settings(max_examples=40, deadline=None)
def test_the_regressor_gives_the_torque_of_pinocchio(kinds, seed, parallel, samples):
    robot, rng = random_arm(kinds, seed, parallel)
    motion = some_motion(robot, rng, samples)
    data = robot.model.createData()
    q = robot.configuration(motion.q)
    rnea = np.array([pin.rnea(robot.model, data, q[k], motion.v[k], motion.a[k]) for k in range(samples)])
    torque = rigid_body_regressor(robot, motion) @ standard_parameters(robot)
    np.testing.assert_allclose(torque, rnea - robot.model.armature * motion.a, atol=1e-8)


@random_arms
@settings(max_examples=60, deadline=None)
def test_dependent_columns_are_combinations_of_the_kept_ones(kinds, seed, parallel, samples):
    W, base = base_of(*random_arm(kinds, seed, parallel), samples)
    built = W[:, base.independent] @ base.grouping
    np.testing.assert_allclose(built, W[:, base.dependent], atol=1e-9 * np.linalg.norm(W))


@random_arms
@settings(max_examples=40, deadline=None)
def test_the_rank_is_that_of_the_singular_values(kinds, seed, parallel, samples):
    robot, rng = random_arm(kinds, seed, parallel)
    W, base = base_of(robot, rng, samples)
    scaled = W / np.maximum(np.linalg.norm(W, axis=0), 1e-9 * np.linalg.norm(W))
    assert base.rank == np.linalg.matrix_rank(scaled, tol=1e-7 * np.sqrt(W.shape[1]))


@random_arms
@settings(max_examples=30, deadline=None)
def test_an_orthogonal_mixture_of_the_rows_does_not_matter(kinds, seed, parallel, samples):
    robot, rng = random_arm(kinds, seed, parallel)
    W, base = base_of(robot, rng, samples)
    mixture = np.linalg.qr(rng.normal(size=(len(W), len(W))))[0]
    again = base_parameters_of_matrix(mixture @ W, parameter_names(robot), parameter_units(robot))
    assert again.independent == base.independent


@random_arms
@settings(max_examples=30, deadline=None)
def test_the_units_do_not_matter(kinds, seed, parallel, samples):
    robot, rng = random_arm(kinds, seed, parallel)
    W, base = base_of(robot, rng, samples)
    units = parameter_units(robot)
    gram_millimetres = np.array([{"kg": 1e-3, "kg m": 1e-6, "kg m^2": 1e-9}[unit] for unit in units])
    again = base_parameters_of_matrix(W * gram_millimetres, parameter_names(robot), units)
    assert again.independent == base.independent


def test_streamed_base_parameters_are_those_of_the_whole_regressor(rng, monkeypatch):
    robot = load_robot("example:ur10")
    motion = some_motion(robot, rng, 300)
    log = Log("some", robot.joint_names, motion, 0 * motion.q, UNFILTERED, np.ones(300, dtype=bool))
    whole = base_parameters(torque_regressor(robot, log))
    monkeypatch.setattr(identification.regression.regressor, "WHOLE_LIMIT", 0)
    monkeypatch.setattr(identification.regression.regressor, "_BLOCK", 32)
    streamed = base_parameters(torque_regressor(robot, log))
    assert streamed.independent == whole.independent
    np.testing.assert_allclose(streamed.grouping, whole.grouping, atol=1e-9)


def test_the_triangular_factor_of_blocks_has_the_gram_of_the_whole(rng):
    W = rng.normal(size=(50, 3, 7))
    factor = r_factor([W[:20], W[20:21], W[21:]])
    flat = W.reshape(150, 7)
    np.testing.assert_allclose(factor.T @ factor, flat.T @ flat)


def test_the_rotor_inertia_of_the_first_joint_regroups_with_its_link(rng):
    robot = serial_robot("RR", [placed(), placed(0.5, pin.utils.rotate("x", 1.0))])
    motion = some_motion(robot, rng, 60)
    log = Log("some", robot.joint_names, motion, 0 * motion.q, UNFILTERED, np.ones(60, dtype=bool))
    base = base_parameters(torque_regressor(robot, log, [(effect_named("rotor_inertia"), "j1")]))
    assert base.regroupings()[0].endswith("+ j1.rotor_inertia.inertia")


def test_full_rank_leaves_nothing_to_regroup():
    base = base_parameters_of_matrix(np.diag([1.0, 2.0, 3.0]), ["a", "b", "c"])
    assert (base.independent, base.dependent, base.regroupings()) == ((0, 1, 2), (), ())


def test_rank_zero_keeps_nothing():
    base = base_parameters_of_matrix(np.zeros((5, 3)), ["a", "b", "c"])
    assert (base.rank, base.zero, base.grouping.shape, base.regroupings()) == (0, (0, 1, 2), (0, 3), ())


def test_no_row_at_all_is_rank_zero():
    assert base_parameters_of_matrix(np.zeros((0, 3)), ["a", "b", "c"]).rank == 0


def test_a_zero_column_is_listed_and_regroups_into_nothing():
    base = base_parameters_of_matrix(np.array([[1.0, 0.0], [2.0, 0.0]]), ["a", "b"])
    assert (base.independent, base.zero, base.regroupings()) == ((0,), (1,), ())


def test_a_column_below_the_tolerance_of_its_unit_is_zero():
    # A file with angles of nine digits leaves such columns; they are large against themselves.
    base = base_parameters_of_matrix(np.diag([1.0, 1e-9]), ["a.m", "b.m"], ["kg", "kg"])
    assert base.zero == (1,)


def test_a_column_of_rounding_errors_regroups_into_nothing():
    # A passive joint that stands still against the base: its angle cancels to 1e-16.
    W = np.array([[1.0, 1e-16, 2.0], [0.0, 3e-17, 1.0], [1.0, 2e-16, 2.0]])
    base = base_parameters_of_matrix(W, ["a", "b", "c"])
    assert (base.zero, base.base_names, base.regroupings()) == ((1,), ("a", "c"), ())


def test_a_small_column_of_another_unit_is_kept():
    base = base_parameters_of_matrix(np.diag([1.0, 1e-9]), ["a.m", "a.Izz"], ["kg", "kg m^2"])
    assert base.independent == (0, 1)


def test_the_condition_number_does_not_see_the_scale_of_columns():
    # Closed form: two unit columns at 60 degrees have singular values sqrt(1 + 1/2) and sqrt(1 - 1/2).
    base = base_parameters_of_matrix(np.array([[1.0, 500.0], [0.0, 500.0 * np.sqrt(3)]]), ["a", "b"])
    assert base.condition == pytest.approx(np.sqrt(3))


def test_negative_and_unit_coefficients_are_printed_plainly():
    a, b = np.array([1.0, 0.0, 2.0]), np.array([0.0, 1.0, 1.0])
    base = base_parameters_of_matrix(np.column_stack([a, b, a - 2.5 * b]), ["a", "b", "c"])
    assert base.regroupings() == ("aR = a + c", "bR = b - 2.5 c")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param(
            lambda: base_parameters_of_matrix(np.eye(2), ["a"]),
            "2 columns came with 1 names and 2 units: give one for each",
            id="names and columns that do not match",
        ),
        pytest.param(
            lambda: base_parameters_of_matrix(np.array([[np.nan]]), ["a"]),
            "values that are not finite: give finite motion",
            id="a regressor that is not finite",
        ),
        pytest.param(
            lambda: base_parameters_of_matrix(np.eye(2), ["a", "b"]).values(np.zeros(3)),
            "3 values were given for 2 parameters",
            id="values for another number of parameters",
        ),
        pytest.param(lambda: r_factor([]), "No block of the regressor was given", id="no block at all"),
    ],
)
def test_what_cannot_be_is_refused(call, message):
    with pytest.raises(ParameterError, match=message):
        call()


CODE = """
import numpy
from identification.regression.triangular import one_blas_thread
from threadpoolctl import threadpool_info

with one_blas_thread():
    import scipy.linalg
    print([one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"])
"""


def test_a_linear_algebra_that_is_loaded_late_has_one_thread_too():
    threads = {name: "2" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
    done = subprocess.run(
        [sys.executable, "-c", CODE], env={**os.environ, **threads}, capture_output=True, text=True, check=True
    )
    counts = done.stdout.strip()
    assert set(counts.strip("[]").split(", ")) == {"1"}
