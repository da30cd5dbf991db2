"""Feedforward as plain Python. Oracles: the corrected model's inverse dynamics by Pinocchio, and closed forms."""

import csv
import io
import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Diagnosis
from identification.export.corrected.corrected_model import corrected_model
from identification.export.uses.feedforward import COLUMNS, feedforward_code, feedforward_table, loaded, over_samples
from phantom_dyn import load_robot
from phantom_dyn.array_types import read_only
from phantom_dyn.dynamics.dynamics import gravity_torque, inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

# Of one effect at a time the drive has to give the model's torque less the effect's.
EXACT = {
    "viscous_friction": ("elbow", (0.5,)),
    "coulomb_friction": ("elbow", (1.0,)),
    "direction_dependent_friction": ("shoulder", (2.0, 1.0, 0.5, 0.2)),
    "stribeck_friction": ("elbow", (1.0, 1.5, 0.2)),
    "load_dependent_friction": ("elbow", (0.2,)),
    "temperature_dependent_friction": ("elbow", (1.0, 0.5, -0.02, -0.01, 40.0)),
    "torque_offset": ("elbow", (1.0,)),
    "torque_constant": ("shoulder", (0.8,)),
    "rotor_inertia": ("elbow", (0.1,)),
    "payload": (None, (0.5, 0.02, 0.0, -0.4)),
    "parasitic_spring": ("elbow", (3.0, 0.2)),
    "joint_coupling": ("shoulder+elbow", (0.5, 0.6, 0.3, 0.05)),
    "cogging": ("elbow", (7.0, 14.0, 0.8, 0.3, 0.2, 1.0)),
    "base_tilt": (None, (0.1, 0.1, 0.0)),
    "encoder_offset": ("elbow", (0.1,)),
}


def some(robot: Robot) -> Motion:
    q, v, a = np.random.default_rng(3).standard_normal((3, 20, robot.nv))
    return Motion(np.arange(20.0), 0.3 * q, v, a)


def torques(code: str, motion: Motion) -> np.ndarray:
    law = loaded(code)["torque"]
    return np.array(
        [law(q, v, a) for q, v, a in zip(*(x.tolist() for x in (motion.q, motion.v, motion.a)), strict=True)]
    )


def strong(diagnosis: Diagnosis, largest: float = 1e3) -> Diagnosis:
    """A diagnosis of recordings whose largest torque on every joint is so large [N m]."""
    evidence = diagnosis.evidence
    return replace(diagnosis, evidence=replace(evidence, tau_measured=np.full_like(evidence.tau_measured, largest)))


@pytest.fixture
def none(diagnosed) -> Diagnosis:
    """A diagnosis without findings."""
    return strong(diagnosed())


@pytest.mark.parametrize("name", EXACT)
def test_the_law_is_the_corrected_models_torque(name, planar, none):
    joint, theta = EXACT[name]
    operation = Operation.of(planar, some(planar))
    wanted = operation.tau - effect_named(name).torque(planar, operation, joint, np.array(theta))
    found = torques(feedforward_code(corrected_model(planar, (KnownEffect(name, joint, theta),)), none), operation)
    np.testing.assert_allclose(found, wanted, atol=1e-9)


@pytest.mark.parametrize("name", ["arm3.urdf", "arm3.xml", "parallelogram.urdf", "pendulum.urdf"])
def test_robots_of_all_kinds_need_pinocchios_torques(name, robots, made_up):
    robot = load_robot(robots / name)
    code = feedforward_code(corrected_model(robot, ()), strong(made_up(robot.joint_names, findings=0, samples=40)))
    limits = np.array(loaded(code)["LIMITS"])
    wanted = np.clip(inverse_dynamics(robot, some(robot)), -limits, limits)
    np.testing.assert_allclose(torques(code, some(robot)), wanted, atol=1e-9)


def test_the_file_runs_without_anything_but_python(planar, none, tmp_path):
    corrected = corrected_model(planar, (KnownEffect("coulomb_friction", "elbow", (0.5,)),))
    (tmp_path / "feedforward.py").write_text(feedforward_code(corrected, none))
    motion = some(planar)
    ask = "import sys, json; sys.path.insert(0, '.'); import feedforward as f; " + (
        f"print(json.dumps(f.torque({motion.q[0].tolist()}, {motion.v[0].tolist()}, {motion.a[0].tolist()})))"
    )
    done = subprocess.run([sys.executable, "-I", "-S", "-c", ask], cwd=tmp_path, capture_output=True, text=True)
    assert done.stderr == ""
    np.testing.assert_allclose(json.loads(done.stdout), inverse_dynamics(corrected.robot, motion)[0], atol=1e-9)


def test_gravity_is_pinocchios(planar, none):
    law = loaded(feedforward_code(corrected_model(planar, ()), none))
    q = some(planar).q
    found = [law["gravity"](row) for row in q.tolist()]
    np.testing.assert_allclose(found, gravity_torque(planar, q), atol=1e-9)


def test_headroom_is_the_limit_less_the_torque(planar, none):
    law = loaded(feedforward_code(corrected_model(planar, (KnownEffect("torque_saturation", "elbow", (2.0,)),)), none))
    needed = gravity_torque(planar, np.array([[0.3, 0.2]]))[0]
    assert law["headroom"]([0.3, 0.2], [0.0, 0.0], [0.0, 0.0])[1] == pytest.approx(2.0 - abs(needed[1]))


def test_limits_are_those_of_the_file_where_none_was_found(planar, none):
    # Oracle: the effort of planar2.urdf.
    effects = (KnownEffect("torque_saturation", "elbow", (2.0,)),)
    assert loaded(feedforward_code(corrected_model(planar, effects), none))["LIMITS"] == (40.0, 2.0)


def test_a_limit_of_the_configuration_goes_before_that_of_the_file(planar, none):
    stated = replace(planar, actuators=(replace(planar.actuators[0], torque_limit=7.0), planar.actuators[1]))
    assert loaded(feedforward_code(corrected_model(stated, ()), none))["LIMITS"] == (7.0, 20.0)


def test_a_drive_that_is_late_has_a_lead(planar, none):
    effects = (KnownEffect("input_delay", None, (0.01,)), KnownEffect("actuator_lag", "elbow", (0.02,)))
    assert loaded(feedforward_code(corrected_model(planar, effects), none))["LEAD"] == (0.01, 0.03)


def test_eccentric_encoders_are_seen_through(planar, none):
    # Closed form: a link that turns evenly, read by a disc off its centre.
    size, phase, t = 0.05, 0.3, np.linspace(0, 1, 9)
    q = np.column_stack([0.5 * t**2 + 0.2, 0.3 * np.ones_like(t)])
    v, a = np.column_stack([t, 0 * t]), np.column_stack([np.ones_like(t), 0 * t])
    read, slope = q.copy(), 1 + size * np.cos(q[:, 0] + phase)
    read[:, 0] += size * np.sin(q[:, 0] + phase)
    read_v, read_a = v * np.column_stack([slope, 1 + 0 * t]), a * np.column_stack([slope, 1 + 0 * t])
    read_a[:, 0] -= size * np.sin(q[:, 0] + phase) * v[:, 0] ** 2
    corrected = corrected_model(planar, (KnownEffect("encoder_eccentricity", "shoulder", (size, phase, 1.0)),))
    found = torques(feedforward_code(corrected, none), Motion(t, read, read_v, read_a))
    np.testing.assert_allclose(found, inverse_dynamics(planar, Motion(t, q, v, a)), atol=1e-9)


def test_the_docstring_says_what_it_lacks(planar, none):
    text = feedforward_code(corrected_model(planar, (KnownEffect("backlash", "elbow", (0.02,)),)), none).split('"""')[1]
    assert "Not in it: play (elbow)." in text


HOLDING = [1.2, 0.3], [0.0, 0.0], [0.0, 0.0]  # a posture that needs 10 N m and more at the shoulder


def test_no_more_than_a_limit_is_asked_for(planar, none):
    limited = corrected_model(planar, (KnownEffect("torque_saturation", "shoulder", (2.0,)),))
    needed = gravity_torque(planar, np.array(HOLDING[:1]))[0]
    found = loaded(feedforward_code(limited, none))["torque"](*HOLDING)
    assert abs(needed[0]) > 2.0
    np.testing.assert_allclose(found, [np.sign(needed[0]) * 2.0, needed[1]], atol=1e-9)


@pytest.mark.parametrize(("share", "refused"), [(0.51, False), (0.49, True)])
def test_more_than_twice_the_largest_measured_torque_is_refused(planar, none, share, refused):
    needed = gravity_torque(planar, np.array(HOLDING[:1]))[0]
    law = loaded(feedforward_code(corrected_model(planar, ()), strong(none, share * float(np.abs(needed).max()))))
    if not refused:
        np.testing.assert_allclose(law["torque"](*HOLDING), needed, atol=1e-9)
        return
    with pytest.raises(ValueError, match=r"joint shoulder needs .*, more than 2 times the largest measured torque"):
        law["torque"](*HOLDING)


def test_a_motion_that_is_refused_still_has_its_headroom(planar, none):
    limited = corrected_model(planar, (KnownEffect("torque_saturation", "shoulder", (2.0,)),))
    needed = gravity_torque(planar, np.array(HOLDING[:1]))[0]
    law = loaded(feedforward_code(limited, strong(none, 0.01)))
    assert law["headroom"](*HOLDING)[0] == pytest.approx(2.0 - abs(needed[0]))


def test_the_table_has_the_torque_of_the_law(planar, none):
    corrected = corrected_model(planar, (KnownEffect("coulomb_friction", "elbow", (0.5,)),))
    rows = list(csv.DictReader(io.StringIO(feedforward_table(corrected, none, feedforward_code(corrected, none)))))
    assert tuple(rows[0]) == COLUMNS
    forward = [r for r in rows if r["over"] == "velocity" and r["joint"] == "elbow" and float(r["v"]) > 0]
    assert float(forward[0]["friction"]) == pytest.approx(0.7 + 0.1 * float(forward[0]["v"]))
    assert all(r["friction"] == "0.0" for r in rows if r["over"] == "position")


def every_law(planar: Robot, none: Diagnosis) -> str:
    effects = tuple(KnownEffect(name, *rest) for name, rest in EXACT.items())
    eccentric = KnownEffect("encoder_eccentricity", "shoulder", (0.05, 0.3, 1.0))
    return feedforward_code(corrected_model(planar, (*effects, eccentric)), none)


# Oracle: the functions of the written file, one sample at a time.
@pytest.mark.parametrize("name", ["gravity", "friction", "cogging", "torque"])
def test_all_samples_at_once_give_the_numbers_of_the_written_file(planar, none, name):
    code, motion = every_law(planar, none), some(planar)
    parts = {"gravity": 1, "friction": 2, "cogging": 1, "torque": 3}[name]
    given = (motion.q, motion.v, motion.a)[:parts]
    wanted = [loaded(code)[name](*(part[k].tolist() for part in given)) for k in range(len(motion.t))]
    found = over_samples(code)[name](*([read_only(row) for row in part.T] for part in given))
    np.testing.assert_allclose(np.transpose(np.broadcast_arrays(*found)), wanted, rtol=1e-12, atol=1e-12)


def test_the_table_has_the_numbers_of_the_written_file(planar, made_up):
    diagnosis = strong(made_up(planar.joint_names, findings=0, samples=40))
    corrected = corrected_model(planar, tuple(KnownEffect(name, *rest) for name, rest in EXACT.items()))
    law = loaded(code := feedforward_code(corrected, diagnosis))
    middle = 0.5 * (diagnosis.evidence.q.min(axis=0) + diagnosis.evidence.q.max(axis=0))
    rows = list(csv.DictReader(io.StringIO(feedforward_table(corrected, diagnosis, code))))
    assert len(rows) == 2 * (91 + 41)
    for row in rows:
        j, q, v = planar.joint_names.index(row["joint"]), middle.tolist(), [0.0, 0.0]
        q[j], v[j] = float(row["q"]), float(row["v"])
        wanted = (
            law["gravity"](q)[j],
            law["friction"](q, v)[j],
            law["cogging"](q)[j],
            law["torque"](q, v, [0.0, 0.0])[j],
        )
        np.testing.assert_allclose([float(row[n]) for n in COLUMNS[4:8]], wanted, rtol=1e-12, atol=1e-12)


def test_a_wrong_number_of_joints_is_refused(planar, none):
    law = loaded(feedforward_code(corrected_model(planar, ()), none))
    with pytest.raises(ValueError, match="give 2 finite numbers, one for each joint: shoulder, elbow"):
        law["torque"]([0.0], [0.0, 0.0], [0.0, 0.0])


def test_loops_that_need_a_solver_are_refused(robots, made_up):
    robot = load_robot(robots / "fourbar.xml")
    with pytest.raises(ParameterError, match="has loops that keep two frames together, which need a solver"):
        feedforward_code(corrected_model(robot, ()), made_up(robot.joint_names, findings=0, samples=40))


def test_arrays_give_the_same_numbers_as_lists(planar, none):
    law = loaded(feedforward_code(corrected_model(planar, (KnownEffect("coulomb_friction", "elbow", (0.5,)),)), none))
    rows = [row[3] for row in (some(planar).q, some(planar).v, some(planar).a)]
    np.testing.assert_allclose(law["torque"](*rows), law["torque"](*(row.tolist() for row in rows)))
