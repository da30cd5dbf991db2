"""Dry friction as MuJoCo has it. Oracle: MuJoCo itself, its constraint forces and recordings of its motions."""

import json
from functools import cache

import numpy as np
import pytest

import phantom_dyn as dyn
from by_night import by_night
from identification.diagnosis.columns.motion.soft_friction import softness
from identification.diagnosis.columns.tolerance_parameters import tolerance_parameters
from identification.notes import Code, Note
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

mujoco = pytest.importorskip("mujoco")

# Whole diagnoses: what they call is checked beside the functions.
pytestmark = pytest.mark.whole

ARM = """<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="{step}"/>
  <worldbody>
    <body name="l1" pos="0 0 0.1">
      <joint name="j1" axis="0 0 1" damping="0.4" frictionloss="0.6" armature="0.05" {solver}/>
      <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.05" mass="3"/>
      <body name="l2" pos="0 0 0.3">
        <joint name="j2" axis="0 1 0" damping="0.4" frictionloss="0.6" armature="0.05"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.04" mass="2"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="j1"/><motor joint="j2"/></actuator>
</mujoco>"""


@cache
def recorded(text: str, seed: int, seconds: float) -> tuple[np.ndarray, ...]:
    """Times, positions, velocities and accelerations of a motion of MuJoCo's, torques and dry friction."""
    model = mujoco.MjModel.from_xml_string(text)
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    size, phase = rng.uniform(0.1, 0.4, (2, 4)), rng.uniform(0, 6, (2, 4))
    w = 2 * np.pi * np.array([0.1, 0.2, 0.35, 0.5])
    rows: list[tuple[np.ndarray, ...]] = []
    for t in np.arange(0, seconds, model.opt.timestep):
        place, speed = (size * np.sin(w * t + phase)).sum(1), (size * w * np.cos(w * t + phase)).sum(1)
        if not rows:
            data.qpos[:], data.qvel[:] = place, speed
        torque = 200 * (place - data.qpos) + 20 * (speed - data.qvel) + data.qfrc_bias
        data.ctrl[:] = torque
        start = data.qpos.copy(), data.qvel.copy()
        mujoco.mj_step(model, data)
        rows.append((np.array([t]), *start, data.qacc.copy(), torque, data.qfrc_constraint.copy()))
    return tuple(np.array(column) for column in zip(*rows, strict=True))


def arm(tmp_path, step: float = 0.002, solver: str = "") -> tuple[Robot, str]:
    text = ARM.format(step=step, solver=solver)
    (tmp_path / "arm.xml").write_text(text)
    return dyn.load_robot(tmp_path / "arm.xml"), text


@pytest.mark.parametrize("solver", ["", 'solreffriction="0.05 1"', 'solimpfriction="0.8 0.9 0.001"'])
def test_the_law_is_what_mujoco_adds_to_coulomb_friction(tmp_path, solver):
    # One joint alone is held and moved slowly, so that its friction is not always at its limit.
    robot, text = arm(tmp_path, 1e-4, solver)
    t, q, v, a, _, friction = recorded(text, 1, 4.0)
    motion = Motion(t[:, 0], q, v, a)
    coulomb = modelled_friction(robot, motion) - robot.viscous_friction * v
    law = (coulomb + softness(robot, motion, "j1"))[:, 0]
    within = np.abs(friction[:, 0]) < 0.99 * 0.6
    assert 10 < within.sum() < len(t)  # both ends of the law are seen
    np.testing.assert_allclose(law, -friction[:, 0], atol=0.03)


def test_a_model_of_mujoco_may_rub_softly_and_a_urdf_not(tmp_path, planar2):
    robot, _ = arm(tmp_path)
    soft = [one.owner for one in tolerance_parameters(robot) if one.kind == "softness"]
    assert soft == ["j1", "j2"]
    assert not [one for one in tolerance_parameters(planar2) if one.kind == "softness"]


def log(tmp_path, columns: tuple[np.ndarray, ...], late: int) -> str:
    t, q, _, _, torque, _ = columns
    kept = slice(0, len(t) - late)
    table = np.hstack([t[kept], q[kept], torque[late:]])
    path = tmp_path / "log.csv"
    np.savetxt(path, table, delimiter=",", header="t,q.j1,q.j2,tau.j1,tau.j2", comments="")
    return str(path)


@pytest.mark.parametrize("seed", by_night([3, 2], 0))
def test_mujoco_fits_its_own_model(tmp_path, seed):
    robot, text = arm(tmp_path)
    found = dyn.diagnose(robot, log(tmp_path, recorded(text, seed, 12.0), 0))
    assert (found.verdict, found.findings) == ("no_gap", ())
    assert Note(Code.SOFT_FRICTION) in found.result.notes


@pytest.mark.parametrize("seed", by_night([8, 1, 2], 0))
def test_a_late_torque_is_found_beside_soft_friction(tmp_path, seed):
    # Known truth: five samples. In the motion of seed 3 Stribeck friction on one joint does as well.
    robot, text = arm(tmp_path)
    found = dyn.diagnose(robot, log(tmp_path, recorded(text, seed, 12.0), 5))
    first = found.findings[0]
    assert (first.effect, first.joint) == ("input_delay", None)
    # A joint is left with two noise floors, so that another cause of a tenth of the gap is not ruled out.
    assert first.probability > 0.9


def test_a_recording_of_coulomb_friction_has_none_of_it(tmp_path):
    # The same motion under the torque that Coulomb's law asks for.
    robot, text = arm(tmp_path)
    t, q, v, a, _, none = recorded(text, 2, 12.0)
    torque = inverse_dynamics(robot, Motion(t[:, 0], q, v, a)) + 1e-3 * np.random.default_rng(0).standard_normal(
        q.shape
    )
    found = dyn.diagnose(robot, log(tmp_path, (t, q, v, a, torque, none), 0))
    assert found.findings == ()
    assert Note(Code.SOFT_FRICTION) not in found.result.notes


BARE = ARM.replace('damping="0.4" frictionloss="0.6"', "")


@pytest.fixture(scope="module")
def found_friction(tmp_path_factory):
    """The arm of a file without friction, diagnosed on a recording of MuJoCo's with friction."""
    folder = tmp_path_factory.mktemp("bare")
    (folder / "arm.xml").write_text(BARE.format(step=0.002, solver=""))
    robot = dyn.load_robot(folder / "arm.xml")
    path = log(folder, recorded(ARM.format(step=0.002, solver=""), 2, 12.0), 0)
    return robot, path, dyn.diagnose(robot, path)


def test_dry_friction_that_the_file_lacks_is_found_by_mujocos_law(found_friction):
    _, _, found = found_friction
    assert {(one.effect, one.joint) for one in found.findings} == {
        (effect, joint) for effect in ("coulomb_friction", "viscous_friction") for joint in ("j1", "j2")
    }
    for one in found.findings:
        size = one.parameters["torque" if one.effect == "coulomb_friction" else "coefficient"]
        truth = 0.6 if one.effect == "coulomb_friction" else 0.4
        assert size.value == pytest.approx(truth, rel=0.02)
        assert one.law == ("mujoco" if one.effect == "coulomb_friction" else None)


@pytest.fixture(scope="module")
def saved(found_friction, tmp_path_factory):
    """Folder of the files of that diagnosis."""
    folder = tmp_path_factory.mktemp("saved")
    found_friction[2].save(folder)
    return folder


def test_a_found_law_of_mujoco_is_kept_in_the_file(saved):
    stored = json.loads((saved / "diagnosis.json").read_text())
    assert {one.get("law") for one in stored["findings"] if one["effect"] == "coulomb_friction"} == {"mujoco"}
    assert {one.get("law") for one in stored["findings"] if one["effect"] == "viscous_friction"} == {None}


def test_files_with_soft_friction_are_written(saved):
    # What turns over softly is a property of the recording, as its delay is.
    assert {"corrected.yaml", "corrected.xml"} <= {path.name for path in saved.iterdir()}


def test_soft_friction_of_an_earlier_diagnosis_leaves_no_gap(found_friction, saved):
    robot, path, _ = found_friction
    assert dyn.diagnose(robot, path, known=saved / "corrected.yaml").findings == ()


def test_stribeck_friction_is_found_on_a_robot_of_a_mujoco_file(tmp_path):
    # Oracle: the law, on torques of Pinocchio's along MuJoCo's motion.
    (tmp_path / "arm.xml").write_text(BARE.format(step=0.002, solver=""))
    robot = dyn.load_robot(tmp_path / "arm.xml")
    t, q, v, a, _, none = recorded(ARM.format(step=0.002, solver=""), 2, 12.0)
    torque = inverse_dynamics(robot, Motion(t[:, 0], q, v, a))
    torque[:, 1] += (0.4 + 0.5 * np.exp(-((v[:, 1] / 0.15) ** 2))) * np.sign(v[:, 1])
    torque += 1e-3 * np.random.default_rng(0).standard_normal(q.shape)
    found = dyn.diagnose(robot, log(tmp_path, (t, q, v, a, torque, none), 0))
    assert [(one.effect, one.joint) for one in found.findings] == [("stribeck_friction", "j2")]
    assert found.findings[0].parameters["static_torque"].value == pytest.approx(0.9, rel=0.05)
    assert found.findings[0].law is None
