# pyright: reportAttributeAccessIssue=false
"""Moves within tolerance in corrected files. Oracles: masses that MuJoCo and Pinocchio load, and closed forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Adjusted, Diagnosis
from identification.estimators.consistent.consistent_bodies import pseudo_inertia
from identification.export.all_files import export_texts
from identification.export.corrected.corrected_mjcf import corrected_mjcf
from identification.export.corrected.corrected_model import corrected_model
from identification.export.corrected.found_effects import same_torque_bodies, within_tolerance
from identification.export.uses.feedforward import loaded
from identification.words.note_words import sentences
from phantom_dyn.dynamics.dynamics import gravity_torque, inverse_dynamics, standard_parameters
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.motion import Motion


@pytest.fixture
def adjusted(made_up) -> Callable[..., Diagnosis]:
    """A diagnosis of the arm without findings whose model moved."""

    def make(**changes: float) -> Diagnosis:
        moves = tuple(Adjusted(name.replace("_", " "), change, 0.05) for name, change in changes.items())
        return replace(made_up(("shoulder", "elbow"), findings=0, samples=400), adjusted=moves)

    return make


def test_without_moves_it_is_the_given_robot_itself(planar, adjusted):
    assert within_tolerance(planar, adjusted()) is planar


def test_masses_that_moved_within_tolerance_are_in_all_corrected_files(planar, adjusted, tmp_path):
    texts, noted = export_texts(adjusted(lower_mass=0.1), planar, folder=tmp_path)
    heavier = 1.1 * planar.model.inertias[2].mass
    assert mujoco.MjModel.from_xml_string(texts["corrected.xml"]).body("lower").mass[0] == pytest.approx(heavier)
    assert pin.buildModelFromXML(texts["corrected.urdf"]).inertias[2].mass == pytest.approx(heavier)
    # Of planar arms gravity is linear in the mass of the lower link, whose centre stays.
    q = np.array([[0.3, 0.4]])
    own = loaded(texts["feedforward.py"])["gravity"](q[0].tolist())
    model = planar.model.copy()
    model.inertias[2] = pin.Inertia(heavier, model.inertias[2].lever, model.inertias[2].inertia)
    np.testing.assert_allclose(own, gravity_torque(replace(planar, model=model), q)[0], atol=1e-9)
    assert "The quantity that moved within tolerance is in the corrected files." in sentences(noted.notes)


def test_a_body_that_cannot_be_becomes_one_with_the_same_torques(planar, adjusted, tmp_path):
    # A moment about one axis above the sum of the others cannot be; planar motion sees this one alone.
    diagnosis = adjusted(lower_Iyy=3.0, lower_mass=0.1)
    wanted = within_tolerance(planar, diagnosis)
    texts, noted = export_texts(diagnosis, planar, folder=tmp_path)
    found = replace(planar, model=pin.buildModelFromXML(texts["corrected.urdf"]))
    e = diagnosis.evidence
    plain = replace(wanted, model=wanted.model.copy())
    plain.model.armature = found.model.armature
    motion = Motion(e.t, e.q, e.v, e.a)
    np.testing.assert_allclose(
        inverse_dynamics(found, motion), inverse_dynamics(plain, motion), atol=1e-3 * np.abs(e.tau_measured).max()
    )
    assert "The 2 quantities that moved within tolerance are in the corrected files." in sentences(noted.notes)


def test_moves_that_no_body_can_make_are_told(planar, adjusted, tmp_path):
    # A first moment that would take more moment about the joint than there is; planar motion sees both.
    texts, noted = export_texts(adjusted(lower_center_x=5.0, lower_mass=0.1), planar, folder=tmp_path)
    assert "corrected.xml" in texts
    assert any("No body can have the inertia that was found for lower" in n for n in sentences(noted.notes))


def test_a_body_that_cannot_be_has_one_of_the_same_torques(planar, lab):
    # Oracle: Pinocchio. Moments about axes across the hinges of a planar arm are seen by no motion.
    change = np.zeros_like(standard_parameters(planar))
    change[[4, 9]] = -5.0, -5.0
    wanted, motion = with_parameters(planar, change), lab.motion(2)
    found = same_torque_bodies(wanted, planar, motion)
    assert all(
        np.linalg.eigvalsh(pseudo_inertia(body.toDynamicParameters())).min() > -1e-9
        for body in found.model.inertias[1:]
    )
    torque = inverse_dynamics(wanted, motion)
    np.testing.assert_allclose(inverse_dynamics(found, motion), torque, atol=1e-4 * np.abs(torque).max())


def test_a_delay_is_whole_in_mujoco_at_short_steps(planar):
    model = mujoco.MjModel.from_xml_string(
        corrected_mjcf(corrected_model(planar, (KnownEffect("input_delay", None, (0.02,)),)))
    )
    model.opt.timestep = 2e-4
    data = mujoco.MjData(model)
    acts = []
    for _ in range(150):
        data.ctrl[:] = 1.0
        mujoco.mj_step(model, data)
        acts.append(data.qfrc_actuator[0] > 0.5)
    assert 2e-4 * (np.argmax(acts) + 1) == pytest.approx(0.02, abs=5e-4)
