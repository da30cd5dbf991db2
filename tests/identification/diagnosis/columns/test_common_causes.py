"""Joints that may have a cause in common. Oracles: by hand, and known scales."""

import numpy as np
import pytest

from identification.diagnosis.columns.layout import by_drives, by_scales, scales, together
from identification.diagnosis.columns.terms import merged
from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.result import EffectAt
from identification.diagnosis.search.containment import with_term
from identification.diagnosis.search.rival_sets import stand
from phantom_dyn.model.loading import load_robot


def test_runs_of_joints_in_the_order_of_their_scales_are_tried_together():
    # By hand: 0.9, 1.0 and 1.4, 1.4; a run from 0.9 to 1.4 differs by more than a factor of one and a half.
    runs = by_scales(np.array([1.4, 0.9, 1.4, 1.0]))
    assert runs[0] == (0, 2)
    assert {tuple(sorted(run)) for run in runs} == {(0, 2), (1, 3), (0, 3), (0, 2, 3)}


def test_a_scale_is_found_beside_friction_and_an_offset(rng):
    t = np.linspace(0, 10, 2000)
    model, v = np.column_stack([np.sin(t), np.cos(2 * t)]), np.column_stack([np.cos(3 * t), np.sin(5 * t)])
    measured = model * [1.4, 0.8] + 0.5 * np.sign(v) + 0.2 * v + 0.1
    np.testing.assert_allclose(scales(measured, model, v), [1.4, 0.8], atol=0.02)


def test_drives_of_one_kind_are_tried_together():
    groups = set(by_drives(load_robot("example:ur5")))
    assert (0, 1, 2, 3, 4, 5) in groups
    # The UR5's three wrists have one torque limit and one stem of a name.
    assert (3, 4, 5) in groups


@pytest.fixture(scope="module")
def scaled(lab, planar2):
    """The planar arm whose torque readings are a fifth too small on both joints."""
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    torque = lab.acting(planar2, motion, "torque_constant", "shoulder+elbow", 1.25)
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),))


def test_both_joints_of_an_arm_may_have_one_scale(scaled):
    operation = merged(scaled.columns.operations)
    assert together(scaled.session, operation) == ("shoulder+elbow",)


def test_one_number_on_two_joints_is_found(scaled):
    # Known truth: 1.25 on both.
    term = next(t for t in scaled.columns.terms if t.place == ("torque_constant", "shoulder+elbow"))
    assert len(term.columns) == 1
    found = fit(scaled.problem, (term,))
    assert 1.0 / (1.0 + found.theta[term.columns[0]]) == pytest.approx(1.25, abs=0.01)


def test_a_joint_has_one_torque_constant(scaled):
    shared, single = (
        next(t for t in scaled.columns.terms if t.place == ("torque_constant", joint))
        for joint in ("shoulder+elbow", "elbow")
    )
    assert with_term(frozenset([single]), shared) == frozenset([shared])
    assert with_term(frozenset([shared]), single) == frozenset([single])


def test_one_scale_of_all_joints_is_not_looked_for_beside_bodies_that_are_all_free(scaled):
    # Closed form: with free bodies it changes nothing but the friction of the model.
    scale = next(t for t in scaled.columns.terms if t.place == ("torque_constant", "shoulder+elbow"))
    single = next(t for t in scaled.columns.terms if t.place == ("torque_constant", "elbow"))
    bodies = next(t for t in scaled.columns.terms if t.place == ("inertial_parameters", None))
    assert with_term(frozenset([scale]), bodies) == frozenset([bodies])
    assert with_term(frozenset([bodies]), scale) == frozenset([scale])
    assert with_term(frozenset([single]), bodies) == frozenset([single, bodies])


def test_bodies_of_all_links_are_as_likely_as_one_scale_of_all_joints_beside_friction(lab, planar2):
    # Closed form: torques that are 1.25 times the readings, with friction on both joints that the model lacks.
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    torque = lab.acting(planar2, motion, "torque_constant", "shoulder+elbow", 1.25) - 0.4 * np.sign(motion.v)
    search = lab.prepared(planar2, (lab.recording(planar2, motion, torque),)).search
    places = [("torque_constant", "shoulder+elbow"), *(("coulomb_friction", joint) for joint in ("shoulder", "elbow"))]
    chosen = frozenset(next(t for t in search.terms if t.place == place) for place in places)
    scale = next(t for t in chosen if t.effect.shared)
    standing = stand(search, chosen, scale)
    shares = {rival.effects: rival.probability for rival in standing.rivals}
    assert shares[(EffectAt("inertial_parameters", None),)] == pytest.approx(standing.probability)
    # As many causes either way: what has fewer numbers leads.
    assert standing.instead is None
