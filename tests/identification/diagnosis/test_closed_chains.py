"""Closed chains, diagnosed: linkages that MuJoCo moves, and friction of the passive joints of the PHANToM 1.5."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import phantom_dyn as dyn
from by_night import by_night
from identification.data.recording import Recording
from identification.diagnosis.result import Diagnosis, EffectAt
from identification.pipeline import diagnose
from phantom_dyn import load_robot
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.model.inertia import payload_body
from phantom_dyn.model.robot import Robot
from places import ROBOTS

LAST = {"fourbar": "follower", "fivebar": "left_elbow"}
"""Joint of the body that carries a load: that of frame tip, else the last one."""
LOAD = '<body pos="0 0 0.2"><inertial pos="0 0 0" mass="{}" diaginertia="1e-7 1e-7 1e-7"/></body>'
HELD, STEPS = 2e-3, 8


def recorded(name: str, *changes: tuple[str, str], seed: int = 1) -> tuple[Robot, Recording]:
    """The given model, and what a recording of it in MuJoCo holds whose file has these changes.

    Constraints and dry friction are as stiff as MuJoCo allows. Position controllers work at 500 Hz.
    """
    path = ROBOTS / f"{name}.xml"
    robot, text = replace(load_robot(path), torque_hold="zoh"), path.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep, model.opt.integrator = HELD / STEPS, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.eq_solref[0], model.eq_solimp[0, :2] = [2 * HELD / STEPS, 1.0], 0.9999
    model.dof_solref[:], model.dof_solimp[:, :2] = [2 * HELD / STEPS, 1.0], 0.9999
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    rows = [model.joint(joint).dofadr[0] for joint in robot.joint_names]
    t = np.arange(round(12.0 / HELD)) * HELD
    w = 2 * np.pi * np.array([0.31, 0.83, 1.37])[:, None] * (1 + 0.17 * np.arange(robot.nv))
    wave = np.array([0.45, 0.25, 0.1])[:, None] * np.sin(w * t[:, None, None] + rng.uniform(0, 6, (3, robot.nv)))
    wanted = wave.sum(axis=1) * np.clip(t / 0.5, 0, 1)[:, None]
    q, tau = np.zeros((2, len(t), robot.nv))
    for k in range(len(t)):
        q[k] = data.qpos[rows]
        tau[k] = 20.0 * (wanted[k] - q[k]) - 0.8 * data.qvel[rows]
        data.ctrl[:] = tau[k]
        mujoco.mj_step(model, data, STEPS)
    noise = 0.01 * rng.normal(size=tau.shape), 1e-5 * rng.normal(size=q.shape)
    return robot, Recording("mujoco", robot.joint_names, t, q + noise[1], tau + noise[0])


@pytest.mark.whole
@pytest.mark.parametrize("name", by_night(LAST, 0))
def test_a_linkage_that_is_as_its_model_says_has_no_gap(name):
    diagnosis = dyn.diagnose(*recorded(name))
    assert diagnosis.verdict == "no_gap"
    assert not diagnosis.findings


@pytest.mark.whole
@pytest.mark.parametrize("name", by_night(LAST, 1))
def test_a_load_on_a_linkage_is_found_with_its_mass(name):
    joint = f'name="{LAST[name]}" axis="0 1 0"/>'
    diagnosis = dyn.diagnose(*recorded(name, (joint, joint + LOAD.format(0.2))))
    first = diagnosis.findings[0]
    mass = first.parameters["mass"]
    assert (first.effect, first.joint) == ("payload", None)
    assert abs(mass.value - 0.2) < 2.5 * mass.std < 0.1


@pytest.mark.whole
@pytest.mark.parametrize(("name", "joint"), by_night([("fourbar", "knee"), ("fivebar", "left_elbow")], 1))
def test_dry_friction_of_a_passive_joint_is_found_on_that_joint(name, joint):
    diagnosis = dyn.diagnose(*recorded(name, (f'name="{joint}"', f'name="{joint}" frictionloss="0.03"')))
    first = diagnosis.findings[0]
    assert (first.effect, first.joint) == ("coulomb_friction", joint)
    # MuJoCo's friction gives way a little, as its constraints do.
    assert first.parameters["torque"].value == pytest.approx(0.03, rel=0.05)


@pytest.mark.whole
@pytest.mark.parametrize("name", by_night(LAST, 0))
def test_a_load_that_hides_behind_the_tolerances_is_reported_with_a_mass_that_holds_it(name, lab):
    # Known truth: 60 g, which two tolerances of 5 % on three or four links can take up.
    robot = load_robot(ROBOTS / f"{name}.xml")
    motion = lab.motion(robot.nv, 3, seconds=20.0)
    lever = 2 * robot.model.inertias[payload_body(robot)].lever
    load = effect_named("payload").torque(robot, Operation.of(robot, motion), None, np.array([0.06, *lever]))
    diagnosis = dyn.diagnose(robot, lab.recording(robot, motion, load, noise=0.01, seed=3))
    said = re.search(r"a payload of up to ([\d.]+) kg", " ".join(str(diagnosis).split()))
    assert diagnosis.verdict == "no_gap"
    assert said
    assert 0.06 < float(said.group(1)) < 0.15


TORQUE = 3e-3  # N m, a tenth of what gravity and inertia take
MODELLED = np.array([1.0, 0.0]) * TORQUE  # of elbow and crank


@pytest.fixture(scope="module")
def phantom():
    """Its model has no friction at all."""
    return load_robot("phantom_1_5")


@pytest.fixture(scope="module")
def rubbing(phantom):
    """The same arm whose elbow is modelled with Coulomb friction."""
    assert phantom.passive_names == ("elbow", "crank")
    return replace(phantom, chain=replace(phantom.chain, coulomb_friction=MODELLED))


@pytest.fixture(scope="module")
def with_friction(lab):
    """Diagnosis of an arm whose elbow has so much Coulomb friction more than its model."""

    def run(robot, torque: float) -> Diagnosis:
        motion = lab.motion(3, 3, rate=100.0)
        more = lab.acting(robot, motion, "coulomb_friction", "elbow", torque)
        return diagnose(robot, (lab.recording(robot, motion, more, noise=2e-4, seed=1),))

    return run


@pytest.fixture(scope="module")
def found(with_friction, phantom):
    return with_friction(phantom, TORQUE)


def test_friction_of_a_passive_joint_is_named_on_that_joint(found):
    assert [(f.effect, f.joint) for f in found.findings] == [("coulomb_friction", "elbow")]
    assert found.verdict == "explained"


def test_the_passive_joint_that_turns_at_the_opposite_speed_is_an_equal_rival(found):
    # Closed form: the angle of the crank is minus that of the elbow, so both leave the same torque.
    (finding,) = found.findings
    rivals = {rival.effects: rival.probability for rival in finding.rivals}
    assert rivals[(EffectAt("coulomb_friction", "crank"),)] == pytest.approx(finding.probability)
    assert finding.verdict == "one_of"


def test_friction_of_a_passive_joint_comes_back_within_four_deviations(found):
    torque = found.findings[0].parameters["torque"]
    assert abs(torque.value - TORQUE) < max(4 * torque.std, 0.01 * TORQUE)


@pytest.mark.whole
def test_modelled_friction_of_a_passive_joint_that_is_off_within_its_tolerance_is_no_gap(with_friction, rubbing):
    # 8 % more than modelled, within two tolerances of 5 %.
    inside = with_friction(rubbing, 0.08 * TORQUE)
    assert (inside.verdict, inside.findings) == ("no_gap", ())
    change = {item.quantity: item.change for item in inside.adjusted}["elbow Coulomb friction"]
    assert change == pytest.approx(0.08, abs=0.02)


@pytest.mark.whole
def test_modelled_friction_of_a_passive_joint_that_is_off_by_more_is_a_gap(with_friction, rubbing):
    assert [(f.effect, f.joint) for f in with_friction(rubbing, 0.4 * TORQUE).findings] == [
        ("coulomb_friction", "elbow")
    ]


@pytest.mark.whole
def test_friction_of_a_passive_joint_of_the_branch_is_no_coupling_of_the_joints_that_move_it(lab):
    # Known truth: q3 turns with q5 - q2 as a coupling of these would, and q6 against it.
    branch = load_robot("cea_branch")
    motion = lab.motion(3, 3, rate=100.0)
    more = sum(
        lab.acting(branch, motion, effect, "q3", size)
        for effect, size in (("coulomb_friction", 0.4), ("viscous_friction", 0.3))
    )
    found = diagnose(branch, (lab.recording(branch, motion, more, noise=0.02, seed=1),))
    assert {(f.effect, f.joint) for f in found.findings} == {("coulomb_friction", "q3"), ("viscous_friction", "q3")}
    for finding in found.findings:
        assert finding.rivals[0].effects == (EffectAt(finding.effect, "q6"),)
        assert all(rival.probability < 0.2 for rival in finding.rivals[1:])
