from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from identification.diagnosis.fit.joint_fit import JointFit
from identification.diagnosis.fit.whole_model import Place
from identification.diagnosis.judge.findings import certainty, distinct
from identification.diagnosis.judge.judged_band import narrow_search
from identification.pipeline import diagnose


@pytest.fixture
def rubbing(lab, planar2):
    """Friction on the elbow that the model lacks, and the search that may say so."""
    motion = lab.motion(2, seconds=20.0)
    torque = lab.acting(planar2, motion, "coulomb_friction", "elbow", 0.5)
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),))


@pytest.mark.parametrize("deviations", [0.1, 1.0, 3.0])
def test_one_coefficient_is_as_certain_as_the_normal_law_says(quiet, deviations):
    # Closed form: the square of a standard normal number.
    term = quiet.term("torque_offset", "elbow")
    fitted = JointFit((Place(term, slice(0, 1), slice(1, 1)),), np.array([0.2 * deviations]), np.array([[0.04]]))
    assert certainty(term, fitted) == pytest.approx(2.0 * norm.cdf(deviations) - 1.0)


def test_what_is_not_told_from_zero_is_no_finding(rubbing, planar2):
    # Known truth: friction on the elbow, and no offset.
    plain = narrow_search(rubbing.search, rubbing.noise)
    friction, offset = rubbing.term("coulomb_friction", "elbow"), rubbing.term("torque_offset", "elbow")
    kept, fitted = distinct(plain, frozenset([friction, offset]))
    assert kept == {friction}
    assert [place.term for place in fitted.places] == [friction]


def test_what_goes_with_accelerations_stays_though_nothing_tells_it_from_zero(rubbing, planar2):
    # Known truth: the torque constants are right; beside a load, which they trade with, none would ever be certain.
    plain = narrow_search(rubbing.search, rubbing.noise)
    chosen = frozenset([rubbing.term("coulomb_friction", "elbow"), rubbing.term("torque_constant", "elbow")])
    assert distinct(plain, chosen)[0] == chosen


def test_a_simpler_law_is_named_where_a_richer_one_is_better_by_less_than_the_method_is_accurate_to(lab, pendulum):
    # Known truth: friction of five hundred times the noise, greater by one per cent in one direction.
    robot = replace(pendulum, coulomb_friction=np.zeros(1), viscous_friction=np.zeros(1))
    motion = lab.motion(1, 3, seconds=20.0)
    torque = lab.acting(robot, motion, "coulomb_friction", "pin", 5.0) * np.where(motion.v > 0, 1.01, 1.0)
    found = diagnose(robot, (lab.recording(robot, motion, torque, noise=0.01),)).findings
    assert [(finding.effect, finding.rivals) for finding in found] == [("coulomb_friction", ())]


def test_an_effect_that_is_the_whole_gap_closes_all_of_it_however_small_the_gap(lab, pendulum, trusted):
    # Known truth: an offset as large as the noise in the judged band is all that a trusted model lacks.
    robot, motion = trusted(pendulum), lab.motion(1, 3, seconds=20.0)
    found = diagnose(robot, (lab.recording(robot, motion, 0.0095),))
    assert found.joints[0].rms_before < 1.6 * found.joints[0].noise_floor
    assert [finding.effect for finding in found.findings] == ["torque_offset"]
    assert found.findings[0].gap_closed == pytest.approx(1.0, abs=0.1)
