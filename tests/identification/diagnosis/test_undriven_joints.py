"""Joints without a drive: a pole that swings under a driven cart; the oracle is Pinocchio's forward dynamics."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import phantom_dyn as dyn
from identification.diagnosis.columns.layout import groups_of_joints
from identification.diagnosis.columns.structure import STRUCTURES
from identification.diagnosis.columns.terms import merged, shapes_of, untestable_effects
from identification.diagnosis.fit.flexible import ridge_predictions, state_features
from identification.diagnosis.fit.gap import comparison_torque, measured_torque
from identification.diagnosis.judge.regimes import regimes
from identification.diagnosis.law.joint_residual import inputs_of
from lab import Prepared
from phantom_dyn.effects.catalogue import EFFECTS
from phantom_dyn.model.robot import Robot

ELBOW = 1
# A pole of 0.4 kg at 0.35 m under a cart of 2 kg.
CART_POLE = """<robot name="cart_pole"><link name="rail"/>
<link name="slide"><inertial><origin xyz="0 0 0"/><mass value="2"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="rod"><inertial><origin xyz="0 0 -0.35"/><mass value="0.4"/>
<inertia ixx="0.016" iyy="0.016" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="cart" type="prismatic"><parent link="rail"/><child link="slide"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" effort="100" velocity="5"/><dynamics damping="4"/></joint>
<joint name="pole" type="revolute"><parent link="slide"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-6" upper="6" effort="1" velocity="50"/><dynamics damping="0.004"/></joint></robot>"""
RATE = 200.0
STEPS = np.array([2e-5, 2 * np.pi / 16384])


@pytest.fixture(scope="module")
def idle(lab, planar2) -> Prepared:
    """The planar arm, whose elbow counts as one without a drive."""
    robot = without_drive(planar2)
    return lab.prepared(robot, (lab.recording(robot, lab.motion(2)),))


def without_drive(robot: Robot) -> Robot:
    return replace(robot, actuators=(robot.actuators[0], replace(robot.actuators[ELBOW], actuated=False)))


def test_no_part_of_a_drive_is_tried_on_it_and_friction_and_loads_are(idle):
    robot, operation = idle.session.robot, merged(idle.columns.operations)
    tried = {(effect.name, joint) for effect, joint, _ in shapes_of(robot, operation, ())}
    # By hand: what is left is what a bare hinge can have, with its link and its encoder.
    bare = {name for name, joint in tried if joint == "elbow"} & {effect.name for effect in EFFECTS}
    assert bare == {
        *("viscous_friction", "coulomb_friction", "direction_dependent_friction", "stribeck_friction"),
        *("presliding_friction", "position_dependent_friction", "parasitic_spring", "torque_offset"),
        *("inertial_parameters", "encoder_offset", "encoder_eccentricity"),
    }
    why = {(effect, joint): reason for effect, joint, reason in untestable_effects(robot, operation)}
    assert why["torque_constant", "elbow"] == "elbow has no drive (actuated: false in robot.yaml)"
    assert ("torque_constant", "shoulder") in tried


def test_no_structure_that_scales_its_torque_is_tried_on_it(idle):
    # Of the structures, two are computed from the torque of a drive; the torque of the elbow is its residual.
    tried = {
        one.name
        for one, joint, _ in shapes_of(idle.session.robot, merged(idle.columns.operations), ())
        if joint == "elbow"
    }
    assert {one.name for one in STRUCTURES} - tried == {"drifting_gain", "supply"}


def test_it_shares_no_number_with_driven_joints(idle):
    assert groups_of_joints(idle.session, merged(idle.columns.operations)) == ()


def test_noise_in_the_computed_torque_of_a_joint_without_a_drive_is_not_foreseen_from_itself(idle, rng):
    noise = rng.normal(size=idle.columns.residual[0].shape)
    columns = replace(idle.columns, model_torque=(noise,))
    for row, foreseen in ((0, True), (ELBOW, False)):
        x, use = state_features(columns, idle.logs[0], 0, row), np.ones(len(noise), dtype=bool)
        fits = ridge_predictions([x], [-noise[:, row]], [use], idle.blocks, idle.folds)
        assert (min(error for _, error in fits) < 0.1) is foreseen


def test_the_torque_that_accelerates_its_own_inertia_takes_the_place_of_the_measured_one(idle):
    # Closed form: 1.5 kg at 0.2 m with 0.02 kg m^2 about their centre.
    log = idle.logs[0]
    (moved,) = comparison_torque(idle.problem, (np.zeros((len(log.samples), 2)),))
    np.testing.assert_allclose(moved[:, ELBOW], log.band((0.02 + 1.5 * 0.2**2) * log.motion.a)[:, ELBOW], atol=1e-9)
    assert not moved[:, 0].any()
    (measured,) = measured_torque(idle.problem)
    np.testing.assert_allclose(measured[:, ELBOW], idle.session.in_judged_band((moved,))[0][:, ELBOW])


def test_its_torques_are_no_inputs_of_a_law(idle):
    robot, (log,), (operation,) = idle.session.robot, idle.logs, idle.columns.operations
    own = inputs_of(robot, log, operation, ELBOW, [0]).keys()
    assert not {"tl.elbow", "tau.elbow"} & own
    assert {"q.elbow", "v.elbow", "tau.shoulder"} <= own
    assert "tau.elbow" not in inputs_of(robot, log, operation, 0, [ELBOW])


def test_it_has_no_high_load(idle):
    driven, bare = (regimes(idle.logs[0], idle.columns, 0, row)["high_load"] for row in (0, ELBOW))
    assert driven.any()
    assert not bare.any()


def swung(folder: Path, *, rubs: float) -> tuple[Path, Path]:
    """Model and log of a cart that is led along three sines while its pole swings and rubs in its bearing."""
    urdf = folder / "cart_pole.urdf"
    urdf.write_text(CART_POLE)
    (folder / "robot.yaml").write_text("torque_hold: zoh\njoints: {pole: {actuated: false}}\n")
    model, rng = pin.buildModelFromXML(CART_POLE), np.random.default_rng(3)
    # Within the tolerances: a pole that is lighter and shorter than modelled.
    model.inertias[2] = pin.Inertia(0.39, np.array([0.0, 0.0, -0.357]), model.inertias[2].inertia)
    data, damping = model.createData(), np.array([4.0, 0.004 + rubs])
    t, steps = np.arange(int(20 * RATE)) / RATE, 10
    w, size = 2 * np.pi * np.array([0.45, 0.78, 1.17]), np.array([0.15, 0.09, 0.05])
    led, speed = np.sin(np.outer(t, w)) @ size, np.cos(np.outer(t, w)) @ (size * w)
    q, v, dt = np.array([0.0, 0.1]), np.zeros(2), 1.0 / RATE / steps
    read, torque = np.zeros((2, len(t), 2))

    def moving(state: np.ndarray, tau: np.ndarray) -> np.ndarray:
        return np.concatenate([state[2:], pin.aba(model, data, state[:2], state[2:], tau - damping * state[2:])])

    for k in range(len(t)):
        read[k] = np.round(q / STEPS) * STEPS
        torque[k, 0] = 400.0 * (led[k] - q[0]) + 60.0 * (speed[k] - v[0])
        for _ in range(steps):
            state = np.concatenate([q, v])
            a = moving(state, torque[k])
            b = moving(state + 0.5 * dt * a, torque[k])
            c = moving(state + 0.5 * dt * b, torque[k])
            d = moving(state + dt * c, torque[k])
            q, v = np.split(state + dt / 6.0 * (a + 2.0 * b + 2.0 * c + d), 2)
    torque[:, 0] += 0.005 * torque[:, 0].std() * rng.normal(size=len(t))
    log = folder / "log.npz"
    np.savez(log, **{"t": t, "q.cart": read[:, 0], "q.pole": read[:, 1], "tau.cart": torque[:, 0]})
    return urdf, log


@pytest.mark.whole
def test_a_sound_pole_has_no_gap(tmp_path):
    diagnosis = dyn.diagnose(*swung(tmp_path, rubs=0.0))
    assert diagnosis.verdict == "no_gap"
    assert not diagnosis.findings
    assert ("viscous_friction", "pole") in {(bound.effect, bound.joint) for bound in diagnosis.bounds}


@pytest.mark.whole
def test_a_pole_that_rubs_is_found(tmp_path):
    diagnosis = dyn.diagnose(*swung(tmp_path, rubs=0.03))
    (found,) = diagnosis.findings
    assert (diagnosis.verdict, found.effect, found.joint) == ("explained", "viscous_friction", "pole")
    assert found.parameters["coefficient"].value == pytest.approx(0.03, rel=0.1)
