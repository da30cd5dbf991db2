import numpy as np
import pytest
from scipy.stats import norm

from identification.diagnosis.search.special_cases import certainty, ends_on_nothing, places_of


@pytest.mark.parametrize("deviations", [0.1, 1.0, 3.0])
def test_one_number_is_as_certain_as_the_normal_law_says(deviations):
    # Closed form: the square of a standard normal number.
    found = certainty(np.array([0.2 * deviations]), np.array([[0.04]]))
    assert found == pytest.approx(2.0 * norm.cdf(deviations) - 1.0)


def test_units_do_not_matter_to_a_certainty():
    # Two independent numbers, one of them in millionths: three deviations of each are eighteen squared ones in all.
    found = certainty(np.array([3.0, 3e-6]), np.diag([1.0, 1e-12]))
    assert found == pytest.approx(1.0 - np.exp(-0.5 * 18.0))


@pytest.mark.parametrize(("excess", "nothing"), [(0.0, False), (0.4, False), (9.0, True), (-0.9, True)])
def test_a_torque_constant_at_the_ends_of_what_is_possible_is_none(quiet, planar2, excess, nothing):
    # Closed form: a ratio of 1 / (1 + excess); a tenth and ten are the ends.
    assert ends_on_nothing(planar2, quiet.term("torque_constant", "elbow"), np.array([excess])) == nothing


def test_the_votes_of_stribeck_friction_at_its_bound_belong_to_coulomb_friction(lab, planar2):
    # Known truth: friction that rises with speed, so that a torque that falls with it ends on its bound.
    motion = lab.motion(2, 3)
    torque = -np.sign(motion.v) * (0.5 + 0.2 * np.tanh(2 * np.abs(motion.v))) * [0.0, 1.0]
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque),))
    term = prepared.term("stribeck_friction", "elbow")
    found = prepared.search.evaluate(frozenset([term]))
    assert found.theta[term.columns[1]] == 0.0
    assert places_of(planar2, term, found) == (("coulomb_friction", "elbow"),)
