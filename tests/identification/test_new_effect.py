"""A new effect is one file and one line of the catalogue: `quadratic_drag` goes from its law to a finding in words."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_files import urdf_left_out
from identification.export.corrected.corrected_model import corrected_model
from identification.pipeline import diagnose
from identification.reporting.page.diagnosis_report import report_html
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


@pytest.fixture(scope="module")
def recording(lab, planar2, listed):
    """The planar arm moved along a path, with drag on its elbow."""
    motion = lab.motion(2, 3, seconds=12.0, swing=1.5)
    return lab.recording(planar2, motion, -TRUTH * motion.v * np.abs(motion.v) * [0.0, 1.0])


@pytest.fixture(scope="module")
def diagnosis(planar2, recording):
    return diagnose(planar2, (recording,))


def test_a_free_joint_slows_down_by_the_law(pendulum):
    # Closed form of I dv/dt = -c v |v|: v = v0 / (1 + c v0 t / I).
    rubbed = with_gravity(pendulum, np.zeros(3))
    free = replace(rubbed, viscous_friction=np.zeros(1), coulomb_friction=np.zeros(1))
    inertia, t = mass_matrix(free, np.zeros((1, 1)))[0, 0, 0], np.linspace(0.0, 2.0, 201)
    drag = Cause(catalogue.effect_named("quadratic_drag"), free.joint_names[0], np.array([TRUTH]))
    moved = simulate(free, (drag,), lambda t, q, v: np.zeros(1), t, np.zeros(1), np.full(1, 3.0))
    np.testing.assert_allclose(moved.links.v[:, 0], 3.0 / (1.0 + TRUTH * 3.0 * t / inertia), rtol=1e-5)


@pytest.mark.nightly
def test_it_is_named_where_it_is_and_nothing_else_is(diagnosis):
    assert [(finding.effect, finding.joint) for finding in diagnosis.findings] == [("quadratic_drag", "elbow")]
    assert diagnosis.verdict == "explained"


@pytest.mark.nightly
def test_its_parameter_is_within_its_interval(diagnosis):
    found = diagnosis.findings[0].parameters["coefficient"]
    assert abs(found.value - TRUTH) < 2.0 * found.std < 0.1 * TRUTH


@pytest.mark.nightly
def test_the_report_says_it_in_its_words(diagnosis):
    page = report_html(diagnosis)
    assert "The recording shows quadratic drag of 0.4" in page
    assert "as of a paddle in water" in page
    assert "Look for what the joint moves through" in page


def test_a_model_file_that_cannot_hold_it_says_so(planar2, tmp_path):
    corrected = corrected_model(planar2, (KnownEffect("quadratic_drag", "elbow", (TRUTH,)),))
    left_out = urdf_left_out(corrected, tmp_path / "robot.urdf")
    assert "It has no place for quadratic drag (coefficient): elbow 0.4." in sentences(left_out)
