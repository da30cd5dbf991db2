"""A new effect is one file and one line of the catalogue: `quadratic_drag` goes from its law to a finding in words."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_files import urdf_left_out
from identification.export.corrected.corrected_model import corrected_model
from identification.words.note_words import sentences
from phantom_dyn.dynamics.dynamics import mass_matrix
from phantom_dyn.effects import catalogue
from phantom_dyn.effects.support.changed_robot import with_gravity
from phantom_dyn.simulation.simulate import Cause, simulate
from quadratic_drag import QuadraticDrag

TRUTH = 0.4


@pytest.fixture(scope="module", autouse=True)
def listed():
    with pytest.MonkeyPatch.context() as patch:
        others = (effect for effect in catalogue.EFFECTS if effect.name != QuadraticDrag.name)
        patch.setattr(catalogue, "EFFECTS", (*others, QuadraticDrag()))
        yield


def test_a_free_joint_slows_down_by_the_law(pendulum):
    # Closed form of I dv/dt = -c v |v|: v = v0 / (1 + c v0 t / I).
    rubbed = with_gravity(pendulum, np.zeros(3))
    free = replace(rubbed, viscous_friction=np.zeros(1), coulomb_friction=np.zeros(1))
    inertia, t = mass_matrix(free, np.zeros((1, 1)))[0, 0, 0], np.linspace(0.0, 2.0, 201)
    drag = Cause(catalogue.effect_named("quadratic_drag"), free.joint_names[0], np.array([TRUTH]))
    moved = simulate(free, (drag,), lambda t, q, v: np.zeros(1), t, np.zeros(1), np.full(1, 3.0))
    np.testing.assert_allclose(moved.links.v[:, 0], 3.0 / (1.0 + TRUTH * 3.0 * t / inertia), rtol=1e-5)


def test_a_model_file_that_cannot_hold_it_says_so(planar2, tmp_path):
    corrected = corrected_model(planar2, (KnownEffect("quadratic_drag", "elbow", (TRUTH,)),))
    left_out = urdf_left_out(corrected, tmp_path / "robot.urdf")
    assert "It has no place for quadratic drag (coefficient): elbow 0.4." in sentences(left_out)
